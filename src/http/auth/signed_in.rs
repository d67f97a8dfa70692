//! Who asks: the one place that turns a cookie or a token into a [`Scope`].
//!
//! Handlers name what they need in their arguments and the store names it again in its functions, so a route that
//! forgets to ask does not compile: without an extractor there is no scope, and without a scope no data.

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

/// How often a conversation looks whether its sign-in still counts.
const STILL_SIGNED_IN: Duration = Duration::from_secs(5);

/// Somebody who has proved who they are: a person, a person's program, or the agent of a box.
#[derive(Clone, Debug)]
pub struct SignedIn {
    /// What they may see and change.
    pub scope: Scope,
}

impl SignedIn {
    /// Who sent these headers.
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

    /// Whether these headers would still sign in. A stream that asks does not count as somebody being there: what nobody
    /// sits in front of ends when idle; whoever sends frames asks [`SignedIn::by`] as well. A store that cannot tell ends nothing.
    pub async fn still(app: &App, headers: &HeaderMap) -> bool {
        match Presented::in_headers(headers) {
            Presented::Token(secret) => app.store.tokens().scope_of(secret).await.map_or(true, |scope| scope.is_some()),
            Presented::Cookie(secret) => app.store.cookies().counts(secret, app.sign_in_lasts()).await.unwrap_or(true),
            Presented::Nothing => false,
        }
    }

    /// Resolves once these headers would sign in no more; it is looked every few seconds.
    pub async fn ended(app: &App, headers: &HeaderMap) {
        let mut look = interval(STILL_SIGNED_IN);
        while Self::still(app, headers).await {
            look.tick().await;
        }
    }
}

fn sign_in_first() -> Problem {
    Refusal::NotSignedIn
        .with("Sign in with POST /api/v1/sign-in, or send `Authorization: Bearer trc_…`. A sign-in ends when idle.")
        .header(header::WWW_AUTHENTICATE, "Bearer realm=\"trocar\"")
}

impl FromRequestParts<App> for SignedIn {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, Problem> {
        Self::by(app, &parts.headers).await
    }
}

/// Extractors that let some roles in and refuse the others before anything else of the request is looked at.
macro_rules! only {
    ($($(#[$doc:meta])* $name:ident: $($role:ident)|+, $otherwise:literal;)*) => { $(
        $(#[$doc])*
        #[derive(Clone, Debug)]
        pub struct $name {
            /// What they may see and change.
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
    /// Anybody but a box's agent.
    Member: Administrator | Instructor | Trainee, "A token of a box's agent is for the box's feed and nothing else.";
    /// Those who teach, and those who run the centre.
    Staff: Administrator | Instructor, "This is for administrators and instructors. Ask one of them.";
    /// Those who run the centre.
    Administrator: Administrator, "This is for administrators. Ask one of them.";
}

impl App {
    /// How long a sign-in counts.
    pub fn sign_in_lasts(&self) -> Cookie {
        Cookie { idle: self.settings.idle(), most: self.settings.sign_in() }
    }
}
