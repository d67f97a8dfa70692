//! Identifies the caller: the place that turns a cookie or a token into a [`Scope`].
//!
//! A handler names the roles it accepts by the extractor in its arguments, and passes the extractor's scope to the
//! store. A route without an extractor has no scope to pass on, so a forgotten check does not compile. Nothing prevents a
//! handler from using [`Scope::service`], which sees everything: handlers must not use it. Only [`Scope::upload_scope`]
//! does, for an agent.

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};

use super::presented::PresentedCredential;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::http::client_address::ClientAddress;
use crate::http::connection_places::RequestInProgress;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::state::App;
use crate::ids::PersonId;
use crate::store::{CookieLifetime, PersonRecord};

/// A caller whose identity is known, but who may have to change a password before anything else. Only the routes that
/// this needs accept it: reading the own account, changing the password, signing out.
#[derive(Clone, Debug)]
pub struct Identified {
    /// What the caller may see and change.
    pub scope: Scope,
    /// True if this sign-in may only change the password.
    pub must_change_password: bool,
}

impl Identified {
    /// Identifies the sender of these headers. This counts as activity, so it keeps the sign-in from idling out.
    async fn from_headers(app: &App, headers: &HeaderMap) -> HandlerResult<Self> {
        let found = match PresentedCredential::in_headers(headers, &app.settings.base_path) {
            PresentedCredential::Token(secret) => {
                app.store.tokens().scope_of(secret).await?.map(|scope| (scope, false))
            }
            PresentedCredential::Cookie(secret) => {
                let holder = app.store.cookies().person_of(secret, app.sign_in_lifetime()).await?;
                holder.map(|holder| (holder.person.scope(), holder.must_change_password))
            }
            PresentedCredential::Nothing => None,
        };
        let (scope, must_change_password) = found.ok_or_else(sign_in_first)?;
        Ok(Self { scope: scope.with_rights(app.rights), must_change_password })
    }

    /// Identifies the sender of this request, and protects its connection until the request has ended. The scope has the
    /// client's address.
    async fn from_parts(app: &App, parts: &Parts) -> HandlerResult<Self> {
        let Self { scope, must_change_password } = Self::from_headers(app, &parts.headers).await?;
        if let Some(request) = parts.extensions.get::<RequestInProgress>() {
            request.caller_has_signed_in(scope.actor());
        }
        let ClientAddress(address) = ClientAddress::of_request(parts, app);
        Ok(Self { scope: scope.at_address(address), must_change_password })
    }
}

/// A person who has signed in and whose identity is known, as [`Identified`]. Programs with a token are refused.
#[derive(Clone, Debug)]
pub struct IdentifiedPerson {
    /// What the person may see and change.
    pub scope: Scope,
    /// The account.
    pub id: PersonId,
}

impl FromRequestParts<App> for IdentifiedPerson {
    type Rejection = ProblemResponse;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ProblemResponse> {
        let Identified { scope, .. } = Identified::from_parts(app, parts).await?;
        let Some(id) = scope.person() else {
            return Err(Refusal::Forbidden.with("An agent has no password. Create another token for its box."));
        };
        require_sign_in(&scope)?;
        Ok(Self { scope, id })
    }
}

impl FromRequestParts<App> for Identified {
    type Rejection = ProblemResponse;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ProblemResponse> {
        Self::from_parts(app, parts).await
    }
}

/// An authenticated caller: a person, a person's program, or the agent of a box.
#[derive(Clone, Debug)]
pub struct SignedIn {
    /// What the caller may see and change.
    pub scope: Scope,
}

impl SignedIn {
    /// Authenticates the sender of this request, and refuses one who has to change a password first. This counts as
    /// activity, so it keeps the sign-in from idling out.
    async fn from_parts(app: &App, parts: &Parts) -> HandlerResult<Self> {
        let Identified { scope, must_change_password } = Identified::from_parts(app, parts).await?;
        if must_change_password { Err(change_password_first()) } else { Ok(Self { scope }) }
    }

    /// Records activity of the sender of these headers, so that the sign-in does not idle out. One that is no longer
    /// valid stays so.
    pub async fn record_activity(app: &App, headers: &HeaderMap) {
        // `wait_until_ended` notices if the sign-in is no longer valid.
        let _ = Identified::from_headers(app, headers).await;
    }

    /// Whether these headers would still sign in. Unlike [`SignedIn::record_activity`], this does not count as activity:
    /// an unattended page that only watches is signed out when idle. A store error counts as yes, so it ends no stream.
    async fn is_still_valid(app: &App, headers: &HeaderMap) -> bool {
        match PresentedCredential::in_headers(headers, &app.settings.base_path) {
            PresentedCredential::Token(secret) => {
                app.store.tokens().scope_of(secret).await.map_or(true, |scope| scope.is_some())
            }
            PresentedCredential::Cookie(secret) => {
                app.store.cookies().is_valid(secret, app.sign_in_lifetime()).await.unwrap_or(true)
            }
            PresentedCredential::Nothing => false,
        }
    }

    /// When the token in these headers expires, epoch ms; `None` if it never does, or if there is none.
    pub async fn token_expiry(app: &App, headers: &HeaderMap) -> Option<i64> {
        match PresentedCredential::in_headers(headers, &app.settings.base_path) {
            // A store error only delays a warning.
            PresentedCredential::Token(secret) => app.store.tokens().expiry_of(secret).await.unwrap_or_default(),
            PresentedCredential::Cookie(_) | PresentedCredential::Nothing => None,
        }
    }

    /// Resolves once these headers no longer sign in.
    pub async fn wait_until_ended(app: &App, headers: &HeaderMap) {
        let credential = PresentedCredential::in_headers(headers, &app.settings.base_path);
        // Before the check, so that an end between the two is noticed.
        let mut end = app.open_sign_ins.watch(credential);
        if Self::is_still_valid(app, headers).await {
            while end.changed().await.is_ok() {} // the sender sends nothing and is dropped at the end
        }
    }
}

/// The person whose sign-in these headers have, for a request that is also answered without one. Not one who has to
/// change the password first.
pub async fn person_of_cookie(
    app: &App,
    headers: &HeaderMap,
    ClientAddress(address): ClientAddress,
) -> HandlerResult<Option<(PersonRecord, Scope)>> {
    let PresentedCredential::Cookie(secret) = PresentedCredential::in_headers(headers, &app.settings.base_path) else {
        return Ok(None);
    };
    let holder = app.store.cookies().person_of(secret, app.sign_in_lifetime()).await?;
    let person = holder.filter(|holder| !holder.must_change_password).map(|holder| holder.person);
    Ok(person.map(|person| {
        let scope = person.scope().with_rights(app.rights).at_address(address);
        (person, scope)
    }))
}

/// Refuses a program with a token. A token acts until it ends: it must not open another way in, or close those of people.
pub fn require_sign_in(scope: &Scope) -> HandlerResult<()> {
    if scope.token().is_none() {
        return Ok(());
    }
    Err(Refusal::Forbidden.with(
        "A token does not suffice for this, because it could outlast its own end, or shut people out. Sign in with login \
         and password.",
    ))
}

/// A caller who has signed in. Programs with a token are refused before the rest of the request is read.
#[derive(Clone, Debug)]
pub struct BySignIn<C>(pub C);

impl<C: ScopedCaller> FromRequestParts<App> for BySignIn<C> {
    type Rejection = ProblemResponse;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ProblemResponse> {
        let caller = C::from_request_parts(parts, app).await?;
        require_sign_in(caller.scope())?;
        Ok(Self(caller))
    }
}

/// A caller of some roles.
pub trait ScopedCaller: FromRequestParts<App, Rejection = ProblemResponse> {
    /// What the caller may see and change.
    fn scope(&self) -> &Scope;
}

fn sign_in_first() -> ProblemResponse {
    Refusal::NotSignedIn
        .with("Sign in with POST /api/v1/sign-in, or send `Authorization: Bearer trc_…`. An idle sign-in ends.")
        .header(header::WWW_AUTHENTICATE, "Bearer realm=\"trocar\"")
}

fn change_password_first() -> ProblemResponse {
    Refusal::PasswordChangeRequired.with(
        "Another person or the program chose this password. Choose one of your own with POST /api/v1/me/password. Its \
         answer signs you in.",
    )
}

impl FromRequestParts<App> for SignedIn {
    type Rejection = ProblemResponse;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ProblemResponse> {
        Self::from_parts(app, parts).await
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
            type Rejection = ProblemResponse;

            async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ProblemResponse> {
                let SignedIn { scope } = SignedIn::from_parts(app, parts).await?;
                match scope.role() {
                    $(Role::$role)|+ => Ok(Self { scope }),
                    _ => Err(Refusal::Forbidden.with($otherwise)),
                }
            }
        }

        impl ScopedCaller for $name {
            fn scope(&self) -> &Scope {
                &self.scope
            }
        }
    )* };
}

only! {
    /// Every role but a box's agent.
    Member: Administrator | Instructor | Trainee, "An agent's token can only send to the feed of its box.";
    /// Administrators and instructors.
    Staff: Administrator | Instructor, "Only administrators and instructors may do this. Ask one of them.";
    /// Administrators, instructors and the agents of boxes.
    StaffOrAgent: Administrator | Instructor | Agent,
        "Only administrators, instructors and the agents of boxes may do this. Ask one of them.";
    /// Administrators.
    Administrator: Administrator, "Only administrators may do this. Ask one of them.";
}

impl App {
    /// How long a sign-in is valid.
    pub fn sign_in_lifetime(&self) -> CookieLifetime {
        CookieLifetime { idle: self.settings.idle(), max_age: self.settings.sign_in() }
    }
}
