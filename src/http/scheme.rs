//! Whether a client is connected over HTTPS, and the header that makes browsers stay with it (HSTS, RFC 6797).
//!
//! The service knows it of its own TLS connections. Behind a proxy that ends TLS, the proxy states it in
//! `X-Forwarded-Proto` or `Forwarded`; like the client's address, this counts only from a trusted proxy.

use std::net::SocketAddr;

use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::middleware::Next;
use axum::response::Response;

use super::client_address::{ClientAddressHeader, forwarded_parameter};
use super::settings::HttpSettings;
use super::state::App;

/// Mark of a request that arrived over the service's own TLS.
#[derive(Clone, Copy, Debug)]
pub struct Encrypted;

/// Middleware: states [`hsts_days`](HttpSettings::hsts_days) in every answer over HTTPS. Over plain HTTP browsers ignore
/// the header. It leaves out `includeSubDomains`: other hosts of the centre are not ours.
pub async fn keep_to_https(State(app): State<App>, request: Request, next: Next) -> Response {
    let is_https = is_https(&request, &app.settings);
    let mut response = next.run(request).await;
    if is_https {
        let seconds = u64::from(app.settings.hsts_days) * 86_400;
        if let Ok(value) = HeaderValue::try_from(format!("max-age={seconds}")) {
            response.headers_mut().insert(header::STRICT_TRANSPORT_SECURITY, value);
        }
    }
    response
}

fn is_https(request: &Request, settings: &HttpSettings) -> bool {
    if request.extensions().get::<Encrypted>().is_some() {
        return true;
    }
    let peer = request.extensions().get::<ConnectInfo<SocketAddr>>().map(|ConnectInfo(peer)| peer.ip().to_canonical());
    let is_trusted = peer.is_some_and(|peer| settings.trusted_proxies.iter().any(|proxy| proxy.contains(&peer)));
    is_trusted && stated_scheme(request.headers(), settings.client_address_header).as_deref() == Some("https")
}

/// The scheme that the nearest proxy states, in lower case.
fn stated_scheme(headers: &HeaderMap, stated_in: ClientAddressHeader) -> Option<String> {
    let name = match stated_in {
        ClientAddressHeader::XForwardedFor => HeaderName::from_static("x-forwarded-proto"),
        ClientAddressHeader::Forwarded => header::FORWARDED,
    };
    let line = headers.get_all(name).iter().next_back()?.to_str().ok()?;
    let last = line.rsplit(',').next()?;
    let scheme = match stated_in {
        ClientAddressHeader::XForwardedFor => Some(last),
        ClientAddressHeader::Forwarded => forwarded_parameter(last, "proto"),
    };
    scheme.map(|scheme| scheme.trim().to_ascii_lowercase())
}

#[cfg(test)]
mod tests {
    use axum::body::Body;

    use super::*;

    fn is_secure(peer: &str, stated_in: ClientAddressHeader, lines: &[(&str, &str)]) -> bool {
        let settings = HttpSettings {
            trusted_proxies: vec!["10.0.0.1/32".parse().unwrap()],
            client_address_header: stated_in,
            ..HttpSettings::default()
        };
        let mut request = Request::builder().extension(ConnectInfo::<SocketAddr>(peer.parse().unwrap()));
        for (name, value) in lines {
            request = request.header(*name, *value);
        }
        is_https(&request.body(Body::empty()).unwrap(), &settings)
    }

    #[test]
    fn only_a_trusted_proxy_states_the_scheme_and_only_in_its_header() {
        use ClientAddressHeader::{Forwarded, XForwardedFor};
        let (proxy, client) = ("10.0.0.1:9", "10.0.0.2:9");
        let ours = [("x-forwarded-proto", "https")];
        assert!(is_secure(proxy, XForwardedFor, &ours));
        assert!(is_secure("[::ffff:10.0.0.1]:9", XForwardedFor, &[("x-forwarded-proto", "http, HTTPS")]));
        assert!(!is_secure(client, XForwardedFor, &ours));
        assert!(!is_secure(proxy, Forwarded, &ours));
        assert!(!is_secure(proxy, XForwardedFor, &[("x-forwarded-proto", "https, http")]));
        assert!(!is_secure(proxy, XForwardedFor, &[]));
        let forwarded = [("forwarded", "for=192.0.2.1;proto=http, for=192.0.2.7; Proto=\"https\"")];
        assert!(is_secure(proxy, Forwarded, &forwarded));
        assert!(!is_secure(proxy, XForwardedFor, &forwarded));
    }
}
