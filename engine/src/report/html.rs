//! Pieces of HTML that all sections are made of.

use crate::picture::png_bytes;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::path::Path;

/// Longest side of a picture in the page, pixels.
const SHOWN_SIDE: u32 = 400;

/// Text for HTML.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A picture of the run with a line below it; `None` when it is missing or broken.
pub(super) fn figure(path: &Path, caption: &str, alt: &str) -> Option<String> {
    let (data, caption, alt) = (embedded(path)?, escape(caption), escape(alt));
    Some(format!(
        "<figure><img alt=\"{alt}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>"
    ))
}

/// A PNG of the run as base64, scaled down to [`SHOWN_SIDE`]; `None` when it is missing or broken.
fn embedded(path: &Path) -> Option<String> {
    let picture = scene_io::decode_photo(path).ok()?;
    let picture = match picture.width().max(picture.height()) > SHOWN_SIDE {
        true => picture.resize(SHOWN_SIDE, SHOWN_SIDE, image::imageops::FilterType::Triangle),
        false => picture,
    };
    Some(STANDARD.encode(png_bytes(&picture.into_rgb8())))
}

pub(super) fn list(lines: &[String]) -> String {
    let items: String = lines.iter().map(|l| format!("<li>{}</li>\n", escape(l))).collect();
    format!("<ul>\n{items}</ul>\n")
}

pub(super) fn number(x: Option<f64>, digits: usize, unit: &str) -> String {
    // What is not measured and what is not a number are both said in words.
    x.filter(|x| !x.is_nan()).map_or_else(|| "n/a".into(), |x| format!("{x:.digits$}{unit}"))
}

/// `1234567` as `1 234 567`, with narrow spaces at which no line breaks.
pub(super) fn grouped(x: u64) -> String {
    let digits = x.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

/// Sections behind one line that opens them; nothing where all of them are empty.
pub(super) fn folded(title: &str, parts: &[String]) -> String {
    let body = parts.concat();
    match body.is_empty() {
        true => body,
        false => format!("<details class=\"experts\"><summary>{}</summary>\n{body}</details>\n", escape(title)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expert_tables_are_folded_and_numbers_are_whole() {
        assert_eq!(folded("more", &[String::new(), String::new()]), "");
        let page = folded("more", &["<p>a</p>".into()]);
        assert!(page.starts_with("<details") && page.contains("<p>a</p>") && !page.contains("open"), "{page}");
        assert_eq!(number(Some(f64::NAN), 2, " dB"), "n/a");
        assert_eq!(number(Some(12.5), 2, " dB"), "12.50 dB");
    }

    #[test]
    fn names_cannot_break_the_page() {
        assert_eq!(list(&["<b>&".into()]), "<ul>\n<li>&lt;b&gt;&amp;</li>\n</ul>\n");
        assert_eq!(grouped(1_234_567), "1\u{202f}234\u{202f}567");
    }
}
