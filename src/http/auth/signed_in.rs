//! Identifies the caller: the one place that turns a cookie or a token into a [`Scope`].
//!
//! A handler names the roles it accepts by the extractor in its arguments, and every store function takes a scope. A
//! route that forgets the check does not compile: without an extractor there is no scope, and without a scope no data.

use std::time::Duration;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use tokio::time::interval;

use super::presented::Presented;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::http::error::{Answer, Problem, Refusal};
use crate::http::state::App;
use crate::store::Cookie;

/// How often an open WebSocket or stream checks that its sign-in is still valid.
const STILL_SIGNED_IN: Duration = Duration::from_secs(5);

/// An authenticated caller: a person, a person's program, or the agent of a box.
#[derive(Clone, Debug)]
pub struct SignedIn {
    /// What the caller may see and change.
    pub scope: Scope,
}

impl SignedIn {
    /// Authenticates the sender of these headers. This counts as activity, so it keeps the sign-in from idling out.
    pub async fn by(app: &App, headers: &HeaderMap) -> Answer<Self> {
        let scope = match Presented::in_headers(headers) {
            Presented::Token(secret) => app.store.tokens().scope_of(secret).await?,
            Presented::Cookie(secret) => {
                app.store.cookies().person_of(secret, app.sign_in_lasts()).await?.map(|person| person.scope())
            }
            Presented::Nothing => None,
        };
        scope.map(|scope| Self { scope }).ok_or_else(sign_in_first)
    }

    /// Whether these headers would still sign in. Unlike [`SignedIn::from_headers`], this does not count as activity:
    /// an unattended page that only watches is signed out when idle. A store error counts as yes, so it ends no stream.
    pub async fn still(app: &App, headers: &HeaderMap) -> bool {
        match Presented::in_headers(headers) {
            Presented::Token(secret) => app.store.tokens().scope_of(secret).await.map_or(true, |scope| scope.is_some()),
            Presented::Cookie(secret) => app.store.cookies().counts(secret, app.sign_in_lasts()).await.unwrap_or(true),
            Presented::Nothing => false,
        }
    }

    /// Resolves once these headers no longer sign in; checks every `SIGN_IN_CHECK_INTERVAL`.
    pub async fn ended(app: &App, headers: &HeaderMap) {
        let mut check = interval(STILL_SIGNED_IN);
        while Self::still(app, headers).await {
            check.tick().await;
        }
    }
}

fn sign_in_first() -> Problem {
    Refusal::NotSignedIn
        .with("Sign in with POST /api/v1/sign-in, or send `Authorization: Bearer trc_…`. An idle sign-in ends.")
        .header(header::WWW_AUTHENTICATE, "Bearer realm=\"trocar\"")
}

impl FromRequestParts<App> for SignedIn {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, Problem> {
        Self::by(app, &parts.headers).await
    }
}

/// Extractors that accept some roles. They refuse the others before the rest of the request is read.
macro_rules! only {
    ($($(#[$doc:meta])* $name:ident: $($role:ident)|+, $otherwise:literal;)*) => { $(
        $(#[$doc])*
        #[derive(Clone, Debug)]
        pub struct $name {
            /// What the caller may see and change.
            pub scope: Scope,
        }

        impl FromRequestParts<App> for $name {
            type Rejection = Problem;

            async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, Problem> {
                let SignedIn { scope } = SignedIn::by(app, &parts.headers).await?;
                match scope.role() {
                    $(Role::$role)|+ => Ok(Self { scope }),
                    _ => Err(Refusal::Forbidden.with($otherwise)),
                }
            }
        }
    )* };
}

only! {
    /// Every role but a box's agent.
    Member: Administrator | Instructor | Trainee, "An agent's token can only send recordings of its box.";
    /// Administrators and instructors.
    Staff: Administrator | Instructor, "Only administrators and instructors may do this. Ask one of them.";
    /// Administrators.
    Administrator: Administrator, "Only administrators may do this. Ask one of them.";
}

impl App {
    /// How long a sign-in is valid.
    pub fn sign_in_lasts(&self) -> Cookie {
        Cookie { idle: self.settings.idle(), most: self.settings.sign_in() }
    }
}
