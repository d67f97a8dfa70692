//! The address of a client. Behind a proxy every connection comes from the proxy, which states the client's address in
//! a header: `X-Forwarded-For`, or `Forwarded` (RFC 7239).
//!
//! A client can send these headers too. So they count only on a connection from a trusted proxy
//! ([`trusted_proxies`](super::settings::HttpSettings::trusted_proxies)), and only the one that this proxy sets
//! ([`client_address_header`](super::settings::HttpSettings::client_address_header)): a proxy passes the other one
//! through as the client sent it. Each proxy adds an address at the end; the last one that is no trusted proxy is the
//! client's.

use std::convert::Infallible;
use std::net::{IpAddr, SocketAddr};

use axum::extract::{ConnectInfo, FromRequestParts};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, header};
use ipnet::IpNet;
use serde::Deserialize;

use super::state::App;

/// Most addresses of a header that are read: a client could add any number before the proxy's.
const MAX_HOPS: usize = 16;

/// The header that states a client's address.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub enum ClientAddressHeader {
    /// `X-Forwarded-For`.
    #[default]
    #[serde(rename = "x-forwarded-for")]
    XForwardedFor,
    /// `Forwarded`.
    #[serde(rename = "forwarded")]
    Forwarded,
}

/// The address of the client that sent a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientAddress(pub IpAddr);

impl ClientAddress {
    /// The address of the client that sent this request.
    pub fn of_request(parts: &Parts, app: &App) -> Self {
        let peer = parts.extensions.get::<ConnectInfo<SocketAddr>>().map(|ConnectInfo(peer)| peer.ip());
        // Every connection has one; an unspecified address would merely share its counters.
        let peer = peer.unwrap_or(IpAddr::from([0, 0, 0, 0]));
        let settings = &app.settings;
        Self::of(peer, &parts.headers, &settings.trusted_proxies, settings.client_address_header)
    }

    /// From the address of the connection's other end, and the header that trusted proxies set.
    pub fn of(peer: IpAddr, headers: &HeaderMap, trusted: &[IpNet], header: ClientAddressHeader) -> Self {
        let peer = peer.to_canonical();
        let is_trusted = |address: &IpAddr| trusted.iter().any(|network| network.contains(address));
        if !is_trusted(&peer) {
            return Self(peer);
        }
        let mut client = peer;
        for hop in hops(headers, header).into_iter().rev().take(MAX_HOPS) {
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
fn hops(headers: &HeaderMap, header: ClientAddressHeader) -> Vec<Option<IpAddr>> {
    let (name, read): (_, fn(&str) -> Option<IpAddr>) = match header {
        ClientAddressHeader::XForwardedFor => (HeaderName::from_static("x-forwarded-for"), address),
        ClientAddressHeader::Forwarded => (header::FORWARDED, |hop| address(forwarded_parameter(hop, "for")?)),
    };
    // A client may have sent any bytes before the proxy's own.
    let lines: Vec<_> = headers.get_all(name).iter().map(|line| String::from_utf8_lossy(line.as_bytes())).collect();
    lines.iter().flat_map(|line| line.split(',')).map(|hop| read(hop.trim())).collect()
}

/// A parameter of one element of `Forwarded`, without quotes.
pub(super) fn forwarded_parameter<'a>(element: &'a str, wanted: &str) -> Option<&'a str> {
    let mut parameters = element.split(';').filter_map(|parameter| parameter.trim().split_once('='));
    let (_, value) = parameters.find(|(name, _)| name.trim().eq_ignore_ascii_case(wanted))?;
    Some(value.trim().trim_matches('"'))
}

/// An address with or without a port: `192.0.2.1`, `192.0.2.1:80`, `2001:db8::1`, `[2001:db8::1]`, `[2001:db8::1]:80`.
fn address(node: &str) -> Option<IpAddr> {
    let without_brackets = node.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(node);
    without_brackets.parse().ok().or_else(|| node.parse::<SocketAddr>().ok().map(|socket| socket.ip()))
}

impl FromRequestParts<App> for ClientAddress {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, Infallible> {
        Ok(Self::of_request(parts, app))
    }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;
    use proptest::prelude::*;

    use super::ClientAddressHeader::{Forwarded, XForwardedFor};
    use super::*;

    fn client(peer: &str, header: ClientAddressHeader, lines: &[(&'static str, &[u8])]) -> String {
        let trusted = ["10.0.0.0/30".parse().unwrap(), "::1/128".parse().unwrap()];
        let lines =
            lines.iter().map(|(name, value)| (HeaderName::from_static(name), HeaderValue::from_bytes(value).unwrap()));
        ClientAddress::of(peer.parse().unwrap(), &HeaderMap::from_iter(lines), &trusted, header).0.to_string()
    }

    fn behind_proxy(stated: &str) -> String {
        client("10.0.0.1", XForwardedFor, &[("x-forwarded-for", stated.as_bytes())])
    }

    #[test]
    fn only_a_trusted_proxy_states_the_client_s_address() {
        let stated: [(_, &[u8]); 1] = [("x-forwarded-for", b"203.0.113.7")];
        let direct = client("198.51.100.1", XForwardedFor, &stated);
        assert_eq!(direct, "198.51.100.1", "a stranger states what it likes");
        assert_eq!(client("10.0.0.1", XForwardedFor, &stated), "203.0.113.7");
        assert_eq!(client("10.0.0.1", XForwardedFor, &[]), "10.0.0.1");
    }

    #[test]
    fn what_a_client_adds_itself_does_not_count() {
        for stated in ["1.2.3.4, 203.0.113.7", "1.2.3.4, 203.0.113.7, 10.0.0.2", "10.0.0.3,203.0.113.7"] {
            assert_eq!(behind_proxy(stated), "203.0.113.7", "{stated}");
        }
        let both: [(_, &[u8]); 2] = [("forwarded", b"for=1.2.3.4"), ("x-forwarded-for", b"\xff, 203.0.113.7")];
        assert_eq!(client("10.0.0.1", XForwardedFor, &both), "203.0.113.7", "the proxy sets the other one");
        assert_eq!(behind_proxy("203.0.113.7, unknown"), "10.0.0.1");
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
            assert_eq!(client("10.0.0.1", Forwarded, &[("forwarded", stated.as_bytes())]), expected, "{stated}");
        }
        assert_eq!(client("::1", XForwardedFor, &[("x-forwarded-for", b"2001:db8::7")]), "2001:db8::7");
        let mapped = client("::ffff:10.0.0.1", XForwardedFor, &[("x-forwarded-for", b"203.0.113.7:80")]);
        assert_eq!(mapped, "203.0.113.7");
    }

    proptest! {
        #[test]
        fn no_header_breaks_it(line in prop::collection::vec(32..=255_u8, 0..200)) {
            let line: Vec<u8> = line.into_iter().filter(|byte| *byte != 127).collect();
            for (header, name) in [(Forwarded, "forwarded"), (XForwardedFor, "x-forwarded-for")] {
                client("10.0.0.1", header, &[(name, &line)]);
            }
        }
    }
}
