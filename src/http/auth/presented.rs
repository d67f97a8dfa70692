//! The credential in a request's headers: the cookie of a sign-in, or a program's token.

use axum::http::{HeaderMap, HeaderValue, header};
use axum_extra::extract::cookie::{Cookie, SameSite};

use crate::domain::secret::{Secret, SecretHash};
use crate::store::KNOWN_PLACE_LIFETIME;

/// Name of the cookie. With this prefix browsers require `Secure`, `Path=/` and this host.
pub const COOKIE_NAME: &str = "__Host-trocar";

/// Name of the cookie that recognises a browser that has signed in before.
const BROWSER_COOKIE_NAME: &str = "__Host-trocar-browser";

/// The credential of a request, hashed: the secret itself stays in this module.
#[derive(Debug, PartialEq, Eq)]
pub enum PresentedCredential {
    /// `Authorization: Bearer trc_…`.
    Token(SecretHash),
    /// The cookie of a sign-in.
    Cookie(SecretHash),
    /// Neither a token nor a cookie of this service.
    Nothing,
}

impl PresentedCredential {
    /// Reads the headers; a token takes precedence over a cookie.
    pub fn in_headers(headers: &HeaderMap) -> Self {
        match (token(headers), cookie(headers)) {
            (Some(token), _) => PresentedCredential::Token(token.hash()),
            (None, Some(cookie)) => PresentedCredential::Cookie(cookie.hash()),
            (None, None) => PresentedCredential::Nothing,
        }
    }
}

fn token(headers: &HeaderMap) -> Option<Secret> {
    let (scheme, token) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    if scheme.eq_ignore_ascii_case("bearer") { Secret::from_token(token.trim()) } else { None }
}

fn cookie(headers: &HeaderMap) -> Option<Secret> {
    cookie_named(COOKIE_NAME, headers)
}

/// The secret of a browser that has signed in before, to any account.
pub fn browser_secret(headers: &HeaderMap) -> Option<Secret> {
    cookie_named(BROWSER_COOKIE_NAME, headers)
}

fn cookie_named(name: &str, headers: &HeaderMap) -> Option<Secret> {
    headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(Cookie::split_parse)
        .filter_map(Result::ok)
        .find(|cookie| cookie.name() == name)
        .and_then(|cookie| Secret::from_cookie(cookie.value()))
}

/// The `Set-Cookie` header of a sign-in. The cookie ends when the browser closes or the sign-in ends.
pub fn set_cookie(secret: &Secret) -> HeaderValue {
    header_value(cookie_with(secret.as_cookie()))
}

/// The `Set-Cookie` header that lets the browser be recognised at its next sign-ins. It is no sign-in.
pub fn set_browser_cookie(secret: &Secret) -> HeaderValue {
    let mut cookie = cookie_with(secret.as_cookie());
    cookie.set_name(BROWSER_COOKIE_NAME);
    HeaderValue::try_from(format!("{cookie}; Max-Age={}", KNOWN_PLACE_LIFETIME.as_secs()))
        .unwrap_or(HeaderValue::from_static("")) // as in `header_value`
}

/// The `Set-Cookie` header that removes the cookie.
pub fn clear_cookie() -> HeaderValue {
    let mut cookie = cookie_with(String::new());
    cookie.make_removal();
    header_value(cookie)
}

fn cookie_with(value: String) -> Cookie<'static> {
    Cookie::build((COOKIE_NAME, value)).path("/").secure(true).http_only(true).same_site(SameSite::Strict).build()
}

fn header_value(cookie: Cookie<'static>) -> HeaderValue {
    // Name, base64 and attributes are visible ASCII, so this never fails. An empty header would merely
    // fail the sign-in.
    HeaderValue::try_from(cookie.to_string()).unwrap_or(HeaderValue::from_static(""))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn presented(name: header::HeaderName, value: &str) -> PresentedCredential {
        PresentedCredential::in_headers(&HeaderMap::from_iter([(name, HeaderValue::from_str(value).unwrap())]))
    }

    #[test]
    fn a_cookie_has_every_attribute_that_protects_it() {
        let text = set_cookie(&Secret::random()).to_str().unwrap().to_owned();
        for attribute in ["__Host-trocar=", "HttpOnly", "Secure", "SameSite=Strict", "Path=/"] {
            assert!(text.contains(attribute), "{attribute} in {text}");
        }
        assert!(!text.contains("Domain"));
    }

    #[test]
    fn what_was_given_is_recognised_by_its_hash() {
        let secret = Secret::random();
        let token = presented(header::AUTHORIZATION, &format!("bearer {}", secret.as_token()));
        assert_eq!(token, PresentedCredential::Token(secret.hash()));
        let cookie = presented(header::COOKIE, &format!("a=b; {COOKIE_NAME}={}; c=d", secret.as_cookie()));
        assert_eq!(cookie, PresentedCredential::Cookie(secret.hash()));
    }

    #[test]
    fn hostile_headers_present_nothing() {
        let long = format!("Bearer trc_{}", "x".repeat(100_000));
        for value in ["", "Bearer", "Bearer abc", "Bearer trc_", "Basic dHJjXzE6", &long] {
            assert_eq!(presented(header::AUTHORIZATION, value), PresentedCredential::Nothing);
        }
        assert_eq!(
            presented(header::COOKIE, &format!("{COOKIE_NAME}={}", "x".repeat(100_000))),
            PresentedCredential::Nothing
        );
    }
}
