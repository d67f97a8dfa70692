//! The address of a client. Behind a proxy every connection comes from the proxy, which states the client's address in a
//! header: `Forwarded` (RFC 7239) or `X-Forwarded-For`.
//!
//! A client can send these headers too, so they count only on a connection from a trusted proxy
//! ([`HttpSettings::trusted_proxies`](super::settings::HttpSettings::trusted_proxies)). Each proxy adds an address at the
//! end; the last one that is no trusted proxy is the client's.

use std::convert::Infallible;
use std::net::{IpAddr, SocketAddr};

use axum::extract::{ConnectInfo, FromRequestParts};
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use ipnet::IpNet;

use super::state::App;

/// Most addresses of a header that are read: a client could add any number before the proxy's.
const MAX_HOPS: usize = 16;
const X_FORWARDED_FOR: &str = "x-forwarded-for";

/// The address of the client that sent a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientAddress(pub IpAddr);

impl ClientAddress {
    /// From the address of the connection's other end, and the headers.
    pub fn of(peer: IpAddr, headers: &HeaderMap, trusted: &[IpNet]) -> Self {
        let peer = peer.to_canonical();
        let is_trusted = |address: &IpAddr| trusted.iter().any(|network| network.contains(address));
        if !is_trusted(&peer) {
            return Self(peer);
        }
        let mut client = peer;
        for hop in hops(headers).rev().take(MAX_HOPS) {
            // A hop without an address (`unknown`, `_hidden`) hides what is before it.
            let Some(address) = hop else { break };
            client = address.to_canonical();
            if !is_trusted(&client) {
                break;
            }
        }
        Self(client)
    }
}

/// The addresses that proxies have added, the nearest proxy's last; `None` for a hop that states none.
fn hops(headers: &HeaderMap) -> std::vec::IntoIter<Option<IpAddr>> {
    let values = |name: &str| -> Vec<&str> {
        let lines = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
        lines.flat_map(|line| line.split(',')).map(str::trim).collect()
    };
    let forwarded = values(header::FORWARDED.as_str());
    if forwarded.is_empty() {
        return values(X_FORWARDED_FOR).into_iter().map(address).collect::<Vec<_>>().into_iter();
    }
    forwarded.into_iter().map(|hop| address(forwarded_for(hop)?)).collect::<Vec<_>>().into_iter()
}

/// The parameter `for` of one element of `Forwarded`, without quotes.
fn forwarded_for(element: &str) -> Option<&str> {
    let parameters = element.split(';').filter_map(|parameter| parameter.trim().split_once('='));
    let (_, node) = parameters.into_iter().find(|(name, _)| name.trim().eq_ignore_ascii_case("for"))?;
    Some(node.trim().trim_matches('"'))
}

/// An address with or without a port: `192.0.2.1`, `192.0.2.1:80`, `2001:db8::1`, `[2001:db8::1]`, `[2001:db8::1]:80`.
fn address(node: &str) -> Option<IpAddr> {
    let without_brackets = node.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(node);
    without_brackets.parse().ok().or_else(|| node.parse::<SocketAddr>().ok().map(|socket| socket.ip()))
}

impl FromRequestParts<App> for ClientAddress {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, Infallible> {
        let peer = parts.extensions.get::<ConnectInfo<SocketAddr>>().map(|ConnectInfo(peer)| peer.ip());
        // Every connection has one; an unspecified address would merely share its counters.
        let peer = peer.unwrap_or(IpAddr::from([0, 0, 0, 0]));
        Ok(Self::of(peer, &parts.headers, &app.settings.trusted_proxies))
    }
}

#[cfg(test)]
mod tests {
    use axum::http::{HeaderName, HeaderValue};
    use proptest::prelude::*;

    use super::*;

    fn client(peer: &str, lines: &[(&'static str, &str)]) -> String {
        let trusted = ["10.0.0.0/8".parse().unwrap(), "::1/128".parse().unwrap()];
        let lines =
            lines.iter().map(|(name, value)| (HeaderName::from_static(name), HeaderValue::from_str(value).unwrap()));
        ClientAddress::of(peer.parse().unwrap(), &HeaderMap::from_iter(lines), &trusted).0.to_string()
    }

    #[test]
    fn only_a_trusted_proxy_states_the_client_s_address() {
        let stated = [("x-forwarded-for", "203.0.113.7")];
        assert_eq!(client("198.51.100.1", &stated), "198.51.100.1", "a stranger states what it likes");
        assert_eq!(client("10.0.0.1", &stated), "203.0.113.7");
        assert_eq!(client("10.0.0.1", &[]), "10.0.0.1");
    }

    #[test]
    fn what_a_client_adds_itself_does_not_count() {
        for stated in ["1.2.3.4, 203.0.113.7", "1.2.3.4, 203.0.113.7, 10.0.0.9", "10.1.1.1,203.0.113.7"] {
            assert_eq!(client("10.0.0.1", &[("x-forwarded-for", stated)]), "203.0.113.7", "{stated}");
        }
        let both = [("forwarded", "for=203.0.113.7"), ("x-forwarded-for", "1.2.3.4")];
        assert_eq!(client("10.0.0.1", &both), "203.0.113.7");
        assert_eq!(client("10.0.0.1", &[("x-forwarded-for", "203.0.113.7, unknown")]), "10.0.0.1");
    }

    #[test]
    fn addresses_are_read_in_every_form() {
        for (stated, expected) in [
            ("for=203.0.113.7;proto=https;by=10.0.0.1", "203.0.113.7"),
            ("proto=https; For=\"203.0.113.7:4711\"", "203.0.113.7"),
            ("for=\"[2001:db8::7]\"", "2001:db8::7"),
            ("for=\"[2001:db8::7]:4711\"", "2001:db8::7"),
            ("for=\"[::ffff:203.0.113.7]\"", "203.0.113.7"),
            ("for=_hidden", "10.0.0.1"),
        ] {
            assert_eq!(client("10.0.0.1", &[("forwarded", stated)]), expected, "{stated}");
        }
        assert_eq!(client("::1", &[("x-forwarded-for", "2001:db8::7")]), "2001:db8::7");
        assert_eq!(client("::ffff:10.0.0.1", &[("x-forwarded-for", "203.0.113.7:80")]), "203.0.113.7");
    }

    proptest! {
        #[test]
        fn no_header_breaks_it(line in "[ -~]{0,200}", name in prop::sample::select(vec!["forwarded", "x-forwarded-for"])) {
            client("10.0.0.1", &[(name, &line)]);
        }
    }
}
