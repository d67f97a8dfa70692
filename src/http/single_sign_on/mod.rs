//! Single sign-on: begin and finish a sign-in with the provider, sign out there, link accounts.
//!
//! The provider sends the browser back to the page `/single-sign-on`, which passes the answer on with `POST
//! single-sign-on/finish`. Rejected: an address of the API for the provider's answer. The request would come from
//! another site, so that browsers send no cookie that is `SameSite=Strict`, and a failure could show only an error
//! document.

mod attempts;
mod identities;

use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{AppendHeaders, IntoResponse};
use serde::{Deserialize, Serialize};
use tokio::sync::Semaphore;
use utoipa::ToSchema;

use super::auth::presented::{
    PresentedCredential, attempt_secret, browser_secret, clear_cookie, set_attempt_cookie, set_browser_cookie,
    set_cookie,
};
use super::auth::sign_in::{new_origin, require_own_password, too_many_attempts};
use super::auth::signed_in::{BySignIn, Identified, Member, person_of_cookie};
use super::client_address::ClientAddress;
use super::error::{HandlerResult, ProblemResponse, Refusal};
use super::people::PersonResponse;
use super::read::{AnonymousJson, Json};
use super::state::App;
use crate::domain::password_state::PasswordState;
use crate::domain::secret::{PasswordHash, Secret};
use crate::domain::single_sign_on::ProvenIdentity;
use crate::identity_provider::{IdentityProvider, Proof, ProviderError};
use crate::ids::PersonId;
use crate::store::{self, IdentityRefusal, StoreError};
use crate::time::SharedClock;
use attempts::{ATTEMPT_LIFETIME, ProviderAttempt, ProviderAttempts, Purpose};

pub use identities::{
    __path_list, __path_own, __path_remove, __path_remove_own, IdentityResponse, list, own, remove, remove_own,
};

/// Answers of the provider that are verified at once. Each needs one or two requests to the provider.
const MAX_VERIFIED_AT_ONCE: usize = 16;
/// Longest address of the page to show afterwards, bytes.
const MAX_NEXT_BYTES: usize = 1000;
/// The page that the provider sends the browser back to.
const ANSWER_PAGE: &str = "/single-sign-on";

/// Single sign-on of this service.
pub struct SingleSignOn {
    provider: IdentityProvider,
    attempts: ProviderAttempts,
    verifying: Semaphore,
}

impl SingleSignOn {
    /// Single sign-on with this provider.
    pub fn new(provider: IdentityProvider, clock: SharedClock) -> Self {
        Self { provider, attempts: ProviderAttempts::new(clock), verifying: Semaphore::new(MAX_VERIFIED_AT_ONCE) }
    }

    /// The provider.
    pub fn provider(&self) -> &IdentityProvider {
        &self.provider
    }
}

/// Whether people can sign in with a provider.
#[derive(Serialize, ToSchema)]
pub struct SingleSignOnResponse {
    is_set_up: bool,
    /// The provider's name for people; `null` if the settings give none.
    name: Option<String>,
}

/// Read whether people can sign in with a provider
#[utoipa::path(get, path = "/single-sign-on", tag = "sign-in", security(()),
    responses((status = OK, body = SingleSignOnResponse)))]
pub async fn describe(State(app): State<App>) -> Json<SingleSignOnResponse> {
    let name = app.single_sign_on.as_ref().and_then(|set_up| set_up.provider.settings().name.clone());
    Json(SingleSignOnResponse { is_set_up: app.single_sign_on.is_some(), name })
}

/// A sign-in with the provider to begin.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ProviderSignInRequest {
    /// The page to show afterwards: an address from the root of this service, such as `/sessions`. By default `/`.
    next: Option<String>,
}

/// Where a sign-in with the provider continues.
#[derive(Serialize, ToSchema)]
pub struct ProviderSignInResponse {
    /// The provider's address, which the browser opens. It is valid once, for ten minutes, in the browser that asked.
    address: String,
}

/// Begin to sign in with the provider
///
/// The browser then opens `address`. The provider sends it back to the page `/single-sign-on`, with `code` and `state`
/// in the query, or with `error`: pass them on with `POST single-sign-on/finish`.
#[utoipa::path(post, path = "/single-sign-on/start", tag = "sign-in", request_body = ProviderSignInRequest,
    security(()),
    responses((status = OK, body = ProviderSignInResponse,
            headers(("Set-Cookie" = String, description = "`__Host-trocar-single-sign-on`, for ten minutes")))))]
pub async fn start(
    State(app): State<App>,
    address: ClientAddress,
    headers: HeaderMap,
    AnonymousJson(ProviderSignInRequest { next }): AnonymousJson<ProviderSignInRequest>,
) -> HandlerResult<impl IntoResponse> {
    let next = next.unwrap_or_else(|| "/".to_owned());
    if !is_own_page(&next) {
        return Err(ProblemResponse::invalid("next", "is no page of this service; begin with / and give no host"));
    }
    begin(&app, address, &headers, Purpose::SignIn, next)
}

/// A request to link the own account to an account at the provider.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LinkRequest {
    /// The account's password; needed if it has one.
    password: Option<String>,
}

/// Begin to link the own account to an account at the provider
///
/// As `single-sign-on/start`. The browser must still be signed in to this account when the answer comes. A token does
/// not suffice. An account with a password needs it, since the link would let a stranger at an open browser sign in later.
#[utoipa::path(post, path = "/me/identities", tag = "sign-in", request_body = LinkRequest,
    responses((status = OK, body = ProviderSignInResponse,
            headers(("Set-Cookie" = String, description = "`__Host-trocar-single-sign-on`, for ten minutes")))))]
pub async fn start_link(
    State(app): State<App>,
    address: ClientAddress,
    BySignIn(by): BySignIn<Member>,
    headers: HeaderMap,
    Json(LinkRequest { password }): Json<LinkRequest>,
) -> HandlerResult<impl IntoResponse> {
    let person = by.scope.person().ok_or_else(ProblemResponse::not_found)?;
    if app.store.people().get(&by.scope, person).await?.password_state != PasswordState::Missing {
        require_own_password(&app, &by.scope, (person, address), password.unwrap_or_default()).await?;
    }
    begin(&app, address, &headers, Purpose::Link(person), "/account".to_owned())
}

fn begin(
    app: &App,
    ClientAddress(address): ClientAddress,
    headers: &HeaderMap,
    purpose: Purpose,
    next: String,
) -> HandlerResult<impl IntoResponse + use<>> {
    let (set_up, base) = (set_up(app)?, &app.settings.base_path);
    let state = Secret::random();
    let redirect = format!("{}{ANSWER_PAGE}", app.base_url(headers));
    let begun = set_up.provider.authorize(redirect, state.as_cookie()).map_err(refused_by_provider)?;
    // A second attempt in another tab keeps the first one valid.
    let browser = attempt_secret(headers, base).unwrap_or_else(Secret::random);
    let attempt = ProviderAttempt { browser: browser.hash(), expected: begun.expected, purpose, next };
    set_up.attempts.begin(state.hash(), attempt, address);
    let cookie = AppendHeaders([(header::SET_COOKIE, set_attempt_cookie(&browser, ATTEMPT_LIFETIME, base))]);
    Ok((cookie, Json(ProviderSignInResponse { address: begun.address })))
}

/// The provider's answer: the query of the page that it sends the browser to.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ProviderAnswer {
    /// The state that the service gave to the provider.
    state: String,
    /// The provider's code, if it has signed the person in.
    code: Option<String>,
    /// The provider's error, if it has not.
    error: Option<String>,
    /// The provider's address, if it states it.
    iss: Option<String>,
}

/// The account that the provider's answer has signed in or linked.
#[derive(Serialize, ToSchema)]
pub struct ProviderAnswerResponse {
    person: PersonResponse,
    /// True if the provider's account was linked to the account, which was signed in before.
    linked: bool,
    /// The page to show.
    next: String,
}

/// Finish to sign in with the provider, or to link the own account
///
/// The provider's answer is verified. A first sign-in makes an account if the settings say so and a group of the person
/// has a role; an account that was made so gets the role of its groups at each sign-in. A refusal has the member
/// `reason`: `cancelled`, `refused`, `expired`, `untrusted`, `unreachable`, `no-group`, `no-account`, `role-changed`,
/// `being-erased` or `linked-elsewhere`.
#[utoipa::path(post, path = "/single-sign-on/finish", tag = "sign-in", request_body = ProviderAnswer, security(()),
    responses((status = OK, body = ProviderAnswerResponse,
            headers(("Set-Cookie" = String, description = "The cookies of `POST sign-in`; none for a link")))))]
pub async fn finish(
    State(app): State<App>,
    address: ClientAddress,
    headers: HeaderMap,
    AnonymousJson(answer): AnonymousJson<ProviderAnswer>,
) -> HandlerResult<impl IntoResponse> {
    let set_up = set_up(&app)?;
    // Before the attempt is used up, so that it can be sent again; held until the end, which hashes a password.
    let _slot = set_up.verifying.try_acquire().map_err(|_| {
        let busy = Refusal::Busy.with("Many people sign in with the provider at this moment. Try again in a moment.");
        busy.header(header::RETRY_AFTER, 3)
    })?;
    let browser = attempt_secret(&headers, &app.settings.base_path);
    let state = Secret::from_cookie(&answer.state);
    let attempt = state.zip(browser).and_then(|(state, browser)| set_up.attempts.take(state.hash(), browser.hash()));
    let Some(ProviderAttempt { expected, purpose, next, .. }) = attempt else {
        app.throttle.attempt_without_login(address.0).map_err(too_many_attempts)?;
        return Err(expired());
    };
    let code = code_of(answer, set_up)?;
    let proof = set_up.provider.prove(code, expected).await.map_err(refused_by_provider)?;
    let (cookies, person, linked) = match purpose {
        Purpose::SignIn => {
            let (cookies, person) = sign_in(&app, set_up, address, &headers, proof).await?;
            (cookies, person, false)
        }
        Purpose::Link(person) => (Vec::new(), link(&app, address, &headers, proof.identity, person).await?, true),
    };
    let cookies: HeaderMap = cookies.into_iter().map(|cookie| (header::SET_COOKIE, cookie)).collect();
    Ok((cookies, Json(ProviderAnswerResponse { person: person.into(), linked, next })))
}

/// The code in the provider's answer.
fn code_of(answer: ProviderAnswer, set_up: &SingleSignOn) -> HandlerResult<String> {
    let of_other = |iss: &String| Some(iss) != set_up.provider.settings().issuer.as_ref();
    if answer.iss.as_ref().is_some_and(of_other) {
        return Err(untrusted());
    }
    let cancelled = ["access_denied", "consent_required", "interaction_required", "login_required"];
    match (answer.error, answer.code) {
        (Some(error), _) if cancelled.contains(&error.as_str()) => {
            Err(refusal("cancelled", "The sign-in at the provider was cancelled. You can sign in again."))
        }
        (Some(error), _) => {
            tracing::warn!(error, "provider of single sign-on refused a sign-in");
            Err(refused())
        }
        (None, Some(code)) => Ok(code),
        (None, None) => Err(ProblemResponse::invalid("code", "is missing, and so is `error`")),
    }
}

/// Signs the browser in as the person of the proven identity.
async fn sign_in(
    app: &App,
    set_up: &SingleSignOn,
    address: ClientAddress,
    headers: &HeaderMap,
    Proof { identity, id_token }: Proof,
) -> HandlerResult<(Vec<axum::http::HeaderValue>, store::PersonRecord)> {
    let base = &app.settings.base_path;
    let (secret, browser) = (Secret::random(), browser_secret(headers, base).unwrap_or_else(Secret::random));
    let origin = new_origin(headers, address, vec![browser.hash()]);
    let sign_in = store::NewSignIn { secret: secret.hash(), lasts: app.sign_in_lifetime(), origin };
    let unmatchable = tokio::task::spawn_blocking(PasswordHash::unmatchable).await;
    let new = store::NewProviderSignIn {
        sign_in,
        address: address.0,
        id_token,
        make_accounts: set_up.provider.settings().make_accounts,
        unmatchable: unmatchable.map_err(|e| ProblemResponse::internal("hashing a password", e))?,
    };
    let person = app.store.identities().sign_in(identity, new).await?.map_err(not_admitted)?;
    if let PresentedCredential::Cookie(before) = PresentedCredential::in_headers(headers, base) {
        app.store.cookies().delete_replaced(before).await?;
    }
    tracing::info!(person = %person.id, "signed in with the provider");
    Ok((vec![set_cookie(&secret, base), set_browser_cookie(&browser, base)], person))
}

/// Links the proven identity to the account that began it, if the browser is still signed in to it.
async fn link(
    app: &App,
    address: ClientAddress,
    headers: &HeaderMap,
    identity: ProvenIdentity,
    began: PersonId,
) -> HandlerResult<store::PersonRecord> {
    let caller = person_of_cookie(app, headers, address).await?;
    let (person, scope) = caller.filter(|(person, _)| person.id == began).ok_or_else(expired)?;
    if identity.role.is_none() {
        return Err(not_admitted(IdentityRefusal::NoGroup));
    }
    app.store.identities().link(&scope, identity).await.map_err(|error| match error {
        StoreError::Taken { .. } => refusal(
            "linked-elsewhere",
            "Your account at the provider signs in to another account here. An administrator can remove that link on \
             the page People.",
        ),
        other => other.into(),
    })?;
    Ok(person)
}

/// Where the sign-out continues.
#[derive(Serialize, ToSchema)]
pub struct ProviderSignOut {
    /// The provider's address that ends its own sign-in and comes back to this service; `null` if the browser was not
    /// signed in with the provider, or if the provider has no such address.
    address: Option<String>,
}

/// Sign out here, and learn where to sign out at the provider
///
/// As `POST sign-out`. The browser then opens `address`: otherwise the next person at this browser could sign in with
/// the provider without a password.
#[utoipa::path(post, path = "/single-sign-on/sign-out", tag = "sign-in",
    responses((status = OK, body = ProviderSignOut)))]
pub async fn sign_out(State(app): State<App>, _by: Identified, headers: HeaderMap) -> HandlerResult<impl IntoResponse> {
    let base = &app.settings.base_path;
    let ended = match PresentedCredential::in_headers(&headers, base) {
        PresentedCredential::Cookie(secret) => app.store.identities().sign_out(secret).await?,
        PresentedCredential::Token(_) | PresentedCredential::Nothing => None,
    };
    let back = format!("{}/", app.base_url(&headers));
    let address = app
        .single_sign_on
        .as_ref()
        .zip(ended)
        .and_then(|(set_up, id_token)| set_up.provider.sign_out_address(id_token.as_deref(), back));
    let cookie = AppendHeaders([(header::SET_COOKIE, clear_cookie(base))]);
    Ok((cookie, Json(ProviderSignOut { address })))
}

fn set_up(app: &App) -> HandlerResult<&SingleSignOn> {
    let missing = || Refusal::Conflict.with("Single sign-on is not set up. Sign in with login and password.");
    app.single_sign_on.as_ref().ok_or_else(missing)
}

/// Whether this is an address of a page of this service, from its root. Browsers read `//` and `/\` as another host.
fn is_own_page(next: &str) -> bool {
    let is_plain = next.len() <= MAX_NEXT_BYTES && !next.chars().any(|c| c.is_control() || c == '\\');
    is_plain && next.starts_with('/') && !next.starts_with("//")
}

fn refusal(reason: &str, detail: &str) -> ProblemResponse {
    Refusal::SingleSignOn.with(detail).member("reason", reason)
}

fn expired() -> ProblemResponse {
    let detail = "This sign-in was finished before, took longer than ten minutes, or began in another browser. Begin \
                  it again.";
    Refusal::Gone.with(detail).member("reason", "expired")
}

fn refused() -> ProblemResponse {
    refusal("refused", "The provider did not accept the sign-in. Try again; if it fails again, ask an administrator.")
}

fn untrusted() -> ProblemResponse {
    let detail = "The provider's answer could not be verified, so you are not signed in. Try again; if it fails again, \
                  ask an administrator: the log of the service has the cause.";
    refusal("untrusted", detail)
}

fn refused_by_provider(error: ProviderError) -> ProblemResponse {
    tracing::warn!(%error, "sign-in with the provider failed");
    match error {
        ProviderError::Unreachable(_) => Refusal::Busy
            .with(
                "The provider of single sign-on cannot be reached at the moment. Try again in a minute, or sign in \
                 with login and password.",
            )
            .member("reason", "unreachable")
            .header(header::RETRY_AFTER, 60),
        ProviderError::Refused(_) => refused(),
        ProviderError::Untrusted(_) => untrusted(),
    }
}

fn not_admitted(why: IdentityRefusal) -> ProblemResponse {
    match why {
        IdentityRefusal::NoGroup => refusal(
            "no-group",
            "The provider knows you, but none of your groups there has access here. Ask the people who manage these \
             groups to add you to one that has.",
        ),
        IdentityRefusal::NoAccount => refusal(
            "no-account",
            "The provider knows you, but you have no account here that is linked to it. Sign in with login and \
             password, and link your account on the page of your account; or ask an administrator.",
        ),
        IdentityRefusal::RoleChanged => refusal(
            "role-changed",
            "Your groups at the provider have changed between trainee and staff. Your account here keeps its \
             recordings, so it cannot change with them. Ask an administrator to remove the link on the page People: \
             your next sign-in then makes a new account.",
        ),
        IdentityRefusal::BeingErased => refusal(
            "being-erased",
            "Your data here are waiting to be erased, so you cannot sign in. If that is wrong, ask your instructor.",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pages_of_this_service_are_shown_afterwards() {
        for own in ["/", "/sessions/7?t=3.2", "/people#x", "/a//b"] {
            assert!(is_own_page(own), "{own}");
        }
        let long = format!("/{}", "x".repeat(MAX_NEXT_BYTES));
        for other in [
            "",
            "a",
            "//evil.example",
            "/\\evil.example",
            "https://evil.example",
            "javascript:alert(1)",
            "/\n/a",
            &long,
        ] {
            assert!(!is_own_page(other), "{other}");
        }
    }
}
