//! The credential in a request's headers: the cookie of a sign-in, or a program's token.

use std::time::Duration;

use axum::http::{HeaderMap, HeaderValue, header};
use axum_extra::extract::cookie::{Cookie, SameSite};

use crate::domain::secret::{Secret, SecretHash};
use crate::http::base_path::BasePath;
use crate::store::KNOWN_PLACE_LIFETIME;

/// A cookie of the service.
#[derive(Clone, Copy)]
enum CookieKind {
    /// Signs a person in.
    SignIn,
    /// Recognises a browser that has signed in before.
    Browser,
    /// Recognises a browser that is at the provider of single sign-on to sign in.
    ProviderAttempt,
}

impl CookieKind {
    /// Its name. With the prefix `__Host-` browsers require `Secure`, `Path=/` and this host. Below a path the cookie has
    /// that path, so that other services of the host do not receive it, and a second Trocar there has its own: then the
    /// prefix `__Secure-` applies.
    fn name(self, base: &BasePath) -> &'static str {
        match (self, base.is_root()) {
            (Self::SignIn, true) => "__Host-trocar",
            (Self::SignIn, false) => "__Secure-trocar",
            (Self::Browser, true) => "__Host-trocar-browser",
            (Self::Browser, false) => "__Secure-trocar-browser",
            (Self::ProviderAttempt, true) => "__Host-trocar-single-sign-on",
            (Self::ProviderAttempt, false) => "__Secure-trocar-single-sign-on",
        }
    }
}

/// Name of the cookie of a sign-in.
pub fn sign_in_cookie_name(base: &BasePath) -> &'static str {
    CookieKind::SignIn.name(base)
}

/// The credential of a request, hashed: the secret itself stays in this module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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
    pub fn in_headers(headers: &HeaderMap, base: &BasePath) -> Self {
        match (token(headers), cookie_of(CookieKind::SignIn, headers, base)) {
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

/// The secret of a browser that has signed in before, to any account.
pub fn browser_secret(headers: &HeaderMap, base: &BasePath) -> Option<Secret> {
    cookie_of(CookieKind::Browser, headers, base)
}

/// The secret of a browser that has begun to sign in with the provider.
pub fn attempt_secret(headers: &HeaderMap, base: &BasePath) -> Option<Secret> {
    cookie_of(CookieKind::ProviderAttempt, headers, base)
}

fn cookie_of(kind: CookieKind, headers: &HeaderMap, base: &BasePath) -> Option<Secret> {
    let name = kind.name(base);
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
pub fn set_cookie(secret: &Secret, base: &BasePath) -> HeaderValue {
    header_value(cookie_with(CookieKind::SignIn, secret.as_cookie(), base))
}

/// The `Set-Cookie` header that lets the browser be recognised at its next sign-ins. It is no sign-in.
pub fn set_browser_cookie(secret: &Secret, base: &BasePath) -> HeaderValue {
    lasting(cookie_with(CookieKind::Browser, secret.as_cookie(), base), KNOWN_PLACE_LIFETIME)
}

/// The `Set-Cookie` header that lets only this browser finish a sign-in with the provider.
pub fn set_attempt_cookie(secret: &Secret, lifetime: Duration, base: &BasePath) -> HeaderValue {
    lasting(cookie_with(CookieKind::ProviderAttempt, secret.as_cookie(), base), lifetime)
}

fn lasting(cookie: Cookie<'static>, lifetime: Duration) -> HeaderValue {
    let text = format!("{cookie}; Max-Age={}", lifetime.as_secs());
    HeaderValue::try_from(text).unwrap_or(HeaderValue::from_static("")) // as in `header_value`
}

/// The `Set-Cookie` header that removes the cookie.
pub fn clear_cookie(base: &BasePath) -> HeaderValue {
    let mut cookie = cookie_with(CookieKind::SignIn, String::new(), base);
    cookie.make_removal();
    header_value(cookie)
}

fn cookie_with(kind: CookieKind, value: String, base: &BasePath) -> Cookie<'static> {
    let path = if base.is_root() { "/".to_owned() } else { base.to_string() };
    let cookie = Cookie::build((kind.name(base), value)).path(path);
    cookie.secure(true).http_only(true).same_site(SameSite::Strict).build()
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
        let headers = HeaderMap::from_iter([(name, HeaderValue::from_str(value).unwrap())]);
        PresentedCredential::in_headers(&headers, &BasePath::default())
    }

    #[test]
    fn a_cookie_has_every_attribute_that_protects_it() {
        for (base, named) in [("", "__Host-trocar=; Path=/;"), ("/trocar", "__Secure-trocar=; Path=/trocar;")] {
            let secret = Secret::random();
            let text = set_cookie(&secret, &base.parse().unwrap()).to_str().unwrap().to_owned();
            let (name, path) = named.split_once("; ").unwrap();
            assert!(text.starts_with(name), "{name} in {text}");
            let text = format!("{text};");
            for attribute in ["; HttpOnly;", "; Secure;", "; SameSite=Strict;", &format!("; {path}")] {
                assert!(text.contains(attribute), "{attribute} in {text}");
            }
            assert!(!text.contains("Domain"));
        }
    }

    #[test]
    fn what_was_given_is_recognised_by_its_hash() {
        let secret = Secret::random();
        let token = presented(header::AUTHORIZATION, &format!("bearer {}", secret.as_token()));
        assert_eq!(token, PresentedCredential::Token(secret.hash()));
        let cookie = presented(header::COOKIE, &format!("a=b; __Host-trocar={}; c=d", secret.as_cookie()));
        assert_eq!(cookie, PresentedCredential::Cookie(secret.hash()));
    }

    #[test]
    fn hostile_headers_present_nothing() {
        let long = format!("Bearer trc_{}", "x".repeat(100_000));
        for value in ["", "Bearer", "Bearer abc", "Bearer trc_", "Basic dHJjXzE6", &long] {
            assert_eq!(presented(header::AUTHORIZATION, value), PresentedCredential::Nothing);
        }
        assert_eq!(
            presented(header::COOKIE, &format!("__Host-trocar={}", "x".repeat(100_000))),
            PresentedCredential::Nothing
        );
    }
}
