//! Who may talk to the server: pages that it served itself, under a name that means this machine.
//!
//! A page from elsewhere can make a browser connect here; its `Origin` gives it away. A foreign name that was pointed at
//! this machine afterwards (DNS rebinding) makes a foreign page look like our own; its `Host` gives it away. Ports are not
//! compared with ours: a tunnel may have changed them, and neither attack can.
//!
//! A header that says who asks, or what a WebSocket is to be, comes once: of two, whoever checks and whoever acts may read
//! different ones. No request has a body: there is nothing to smuggle another one in.

use axum::http::{HeaderMap, HeaderName, Uri, header};
use std::net::{IpAddr, Ipv6Addr};

/// Headers that come at most once.
const ONCE: [&str; 9] = [
    "host",
    "origin",
    "upgrade",
    "content-length",
    "transfer-encoding",
    "sec-websocket-key",
    "sec-websocket-version",
    "sec-websocket-protocol",
    "sec-websocket-extensions",
];

/// Names that the server answers to.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    /// The word after `--host`.
    given: String,
    /// Where the server listens.
    bound: IpAddr,
}

/// Why a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// No `Host`, or one that is none of ours.
    Host,
    /// The page that asks is not ours.
    Origin,
    /// This header came more than once.
    Twice(&'static str),
    /// There is a body.
    Body,
}

impl Refusal {
    /// What is said to who asks.
    pub(crate) fn text(self) -> String {
        match self {
            Self::Host => "this viewer does not answer to that name; open the address it printed, or start it with \
                           `--host NAME`"
                .into(),
            Self::Origin => "this viewer talks to its own page only".into(),
            Self::Twice(name) => format!("the header `{name}` came more than once; send it once"),
            Self::Body => "requests with a body are not accepted".into(),
        }
    }
}

impl Guard {
    pub(crate) fn new(given: &str, bound: IpAddr) -> Self {
        Self { given: given.trim_matches(['[', ']']).to_ascii_lowercase(), bound }
    }

    /// Judge a request; the `Host` that it names.
    ///
    /// # Errors
    /// [`Refusal`].
    pub(crate) fn judge(&self, uri: &Uri, headers: &HeaderMap) -> Result<String, Refusal> {
        if let Some(name) = ONCE.into_iter().find(|name| headers.get_all(*name).iter().nth(1).is_some()) {
            return Err(Refusal::Twice(name));
        }
        let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        let host = text(header::HOST).ok_or(Refusal::Host)?;
        // `GET http://NAME/` names the host a second time.
        if uri.authority().is_some_and(|authority| !authority.as_str().eq_ignore_ascii_case(host)) {
            return Err(Refusal::Host);
        }
        self.check(Some(host), text(header::ORIGIN))?;
        let is_long = text(header::CONTENT_LENGTH).is_some_and(|length| length != "0");
        if is_long || headers.contains_key(header::TRANSFER_ENCODING) {
            return Err(Refusal::Body);
        }
        Ok(host.into())
    }

    /// Judge a request by its headers `Host` and `Origin`. Programs that are not browsers, and visits by hand, have no
    /// `Origin`.
    ///
    /// # Errors
    /// [`Refusal`] for names and pages that are foreign.
    pub(crate) fn check(&self, host: Option<&str>, origin: Option<&str>) -> Result<(), Refusal> {
        let host = host.ok_or(Refusal::Host)?;
        if !self.is_ours(name_of(host).ok_or(Refusal::Host)?) {
            return Err(Refusal::Host);
        }
        match origin {
            None => Ok(()),
            // The very page this host serves, port and all.
            Some(origin) => match origin.strip_prefix("http://") {
                Some(rest) if rest.eq_ignore_ascii_case(host) => Ok(()),
                _ => Err(Refusal::Origin),
            },
        }
    }

    fn is_ours(&self, name: &str) -> bool {
        let name = name.to_ascii_lowercase();
        if name == self.given {
            return true;
        }
        let here = self.bound.is_loopback() || self.bound.is_unspecified();
        match name.parse::<IpAddr>() {
            // A number cannot be pointed elsewhere.
            Ok(ip) => ip == self.bound || self.bound.is_unspecified() || (here && ip.is_loopback()),
            Err(_) => name == "localhost" && here,
        }
    }
}

/// The name in `NAME`, `NAME:PORT`, `[IPv6]` or `[IPv6]:PORT`.
fn name_of(host: &str) -> Option<&str> {
    let is_port = |port: &str| port.parse::<u16>().is_ok();
    if let Some(rest) = host.strip_prefix('[') {
        let (name, port) = rest.split_once(']')?;
        name.parse::<Ipv6Addr>().ok()?;
        return (port.is_empty() || port.strip_prefix(':').is_some_and(is_port)).then_some(name);
    }
    let name = match host.split_once(':') {
        None => host,
        Some((name, port)) if is_port(port) => name,
        Some(_) => return None,
    };
    (!name.is_empty()).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guard(given: &str, bound: &str) -> Guard {
        Guard::new(given, bound.parse().unwrap())
    }

    #[test]
    fn names_of_this_machine_are_answered_and_foreign_ones_are_not() {
        let local = guard("127.0.0.1", "127.0.0.1");
        for host in ["127.0.0.1:8080", "localhost:8080", "LOCALHOST", "127.0.0.1", "[::1]:80"] {
            assert_eq!(local.check(Some(host), None), Ok(()), "{host}");
        }
        for host in
            ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "10.0.0.1", "", ":80", "a:b", "[::1"]
        {
            assert_eq!(local.check(Some(host), None), Err(Refusal::Host), "{host}");
        }
        assert_eq!(local.check(None, None), Err(Refusal::Host));
    }

    #[test]
    fn a_server_for_others_answers_to_numbers_and_to_the_name_it_was_given() {
        let open = guard("0.0.0.0", "0.0.0.0");
        assert_eq!(open.check(Some("192.168.1.7:8080"), None), Ok(()));
        assert_eq!(open.check(Some("localhost:8080"), None), Ok(()));
        assert_eq!(open.check(Some("evil.example"), None), Err(Refusal::Host));
        let named = guard("Studio.lan", "192.168.1.7");
        assert_eq!(named.check(Some("studio.lan:8080"), None), Ok(()));
        assert_eq!(named.check(Some("192.168.1.7:8080"), None), Ok(()));
        for host in ["localhost", "127.0.0.1", "192.168.1.8"] {
            assert_eq!(named.check(Some(host), None), Err(Refusal::Host), "{host}");
        }
    }

    #[test]
    fn only_the_servers_own_page_may_ask() {
        let local = guard("127.0.0.1", "127.0.0.1");
        let host = Some("127.0.0.1:8080");
        assert_eq!(local.check(host, Some("http://127.0.0.1:8080")), Ok(()));
        for origin in [
            "http://evil.example",
            "http://127.0.0.1:8081",
            "https://127.0.0.1:8080",
            "http://localhost:8080",
            "null",
            "",
        ] {
            assert_eq!(local.check(host, Some(origin)), Err(Refusal::Origin), "{origin}");
        }
    }

    #[test]
    fn what_says_who_asks_is_said_once_and_nothing_follows_it() {
        let local = guard("127.0.0.1", "127.0.0.1");
        let judge = |uri: &str, lines: &[(&'static str, &'static str)]| {
            let mut headers = HeaderMap::new();
            headers.insert(header::HOST, "127.0.0.1:80".parse().unwrap());
            for (name, value) in lines {
                headers.append(*name, value.parse().unwrap());
            }
            local.judge(&uri.parse().unwrap(), &headers)
        };
        let ours = "http://127.0.0.1:80";
        assert_eq!(judge("/", &[]).as_deref(), Ok("127.0.0.1:80"));
        assert_eq!(judge("http://127.0.0.1:80/", &[("origin", ours), ("content-length", "0")]), judge("/", &[]));
        assert_eq!(judge("http://evil.example/", &[]), Err(Refusal::Host));
        assert_eq!(judge("/", &[("origin", ours), ("origin", "http://evil.example")]), Err(Refusal::Twice("origin")));
        assert_eq!(judge("/", &[("host", "127.0.0.1:80")]), Err(Refusal::Twice("host")));
        for name in ONCE {
            assert_eq!(judge("/", &[(name, "1"), (name, "1")]), Err(Refusal::Twice(name)));
        }
        for (name, value) in [("content-length", "1"), ("content-length", "+0"), ("transfer-encoding", "identity")] {
            assert_eq!(judge("/", &[(name, value)]), Err(Refusal::Body), "{name}: {value}");
        }
    }
}
