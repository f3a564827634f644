//! The page: markup, style and script in one document, and what a browser may do with it.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};

const MARKUP: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/page.css");
const SCRIPTS: [&str; 4] = [
    include_str!("page/camera.js"),
    include_str!("page/curve.js"),
    include_str!("page/page.js"),
    include_str!("page/crop.js"),
];

/// The document, and the digests of its two parts that act.
pub(crate) struct Page {
    pub(crate) text: String,
    style: String,
    script: String,
}

impl Page {
    pub(crate) fn new() -> Self {
        // One function around all: its names are nobody else's.
        let script = format!("(() => {{\n\"use strict\";\n{}\n}})();", SCRIPTS.join("\n"));
        let text = MARKUP.replacen("{{style}}", STYLE, 1).replacen("{{script}}", &script, 1);
        let digest = |part: &str| format!("'sha256-{}'", STANDARD.encode(Sha256::digest(part)));
        Self { text, style: digest(STYLE), script: digest(&script) }
    }

    /// The content security policy of the page served under the name `host`: its own style and script, a connection back,
    /// and nothing else. An empty `host` may not even connect.
    pub(crate) fn policy(&self, host: &str) -> String {
        // `'self'` should mean the WebSocket, too; some browsers think of HTTP only.
        let connect = if host.is_empty() { "'none'".into() } else { format!("'self' ws://{host}") };
        format!(
            "default-src 'none'; script-src {}; style-src {}; connect-src {connect}; img-src data:; base-uri 'none'; \
             form-action 'none'; frame-ancestors 'none'",
            self.script, self.style
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_one_document_that_asks_nobody_for_anything() {
        let page = Page::new();
        assert!(page.text.starts_with("<!doctype html>") && !page.text.contains("{{"));
        // The one address in it names a vocabulary of the markup.
        let text = page.text.replace("http://www.w3.org/2000/svg", "");
        for part in ["http://", "https://", "//cdn", "@import", "src=", "url("] {
            assert!(!text.contains(part), "{part}");
        }
    }

    #[test]
    fn the_policy_allows_what_the_page_holds_and_nothing_else() {
        let page = Page::new();
        let inside = |tag: &str| {
            let (_, rest) = page.text.split_once(&format!("<{tag}>")).unwrap();
            rest.split_once(&format!("</{tag}>")).unwrap().0
        };
        let policy = page.policy("127.0.0.1:80");
        for tag in ["style", "script"] {
            let digest = STANDARD.encode(Sha256::digest(inside(tag)));
            assert!(policy.contains(&format!("{tag}-src 'sha256-{digest}';")), "{tag}");
        }
        assert!(policy.contains("default-src 'none'") && !policy.contains("unsafe"));
        assert!(page.policy("").contains("connect-src 'none'"));
        assert!(!page.text.contains(" style=") && !page.text.contains(" onclick="));
    }
}
