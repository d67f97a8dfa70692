//! Invites trainees: makes their accounts, and links for choosing the passwords.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use crate::domain::enrolment::RowProblem;
use crate::domain::password_state::PasswordState;
use crate::domain::scope::Scope;
use crate::domain::secret::Secret;
use crate::domain::text::{Code, Key, Login, Name};
use crate::http::auth::password::HashRequester;
use crate::http::auth::signed_in::{BySignIn, Staff};
use crate::http::error::{FieldError, HandlerResult, ProblemResponse, Refusal};
use crate::http::read::{Json, Params, reference_problem};
use crate::http::show::{PageResponse, Time};
use crate::http::state::App;
use crate::ids::{GroupId, PersonId, TraineeId};
use crate::store::{InvitationTerms, Invitations, Invitee, PasswordLinkRecord, PersonRecord, TraineeAccount};

/// Maximum number of trainees that one request invites.
const MAX_INVITATIONS: usize = 500;

/// How a trainee signs in.
#[derive(Debug, Serialize, ToSchema)]
pub struct TraineeAccountResponse {
    trainee: TraineeId,
    code: Code,
    name: Name,
    /// The account; `null`: the trainee has none.
    person: Option<PersonId>,
    /// The login of the account.
    login: Option<Login>,
    /// Who chose the password, and whether it must be changed; `missing`: the trainee has not chosen one yet.
    password: Option<PasswordState>,
    /// When the link for the password expires; `null`: no link is valid.
    link_expires_at: Option<Time>,
}

impl From<TraineeAccount> for TraineeAccountResponse {
    fn from(of: TraineeAccount) -> Self {
        let TraineeAccount { trainee_id, code, name, person_id, login, password_state, link_expires_at_ms } = of;
        let link_expires_at = link_expires_at_ms.map(Time);
        Self { trainee: trainee_id, code, name, person: person_id, login, password: password_state, link_expires_at }
    }
}

/// Selects trainees.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct TraineeAccountsQuery {
    /// The id of a group: only its trainees.
    group: Option<GroupId>,
}

/// List how the trainees sign in
///
/// The trainees that the caller sees, by name, in one answer.
#[utoipa::path(get, path = "/trainee-accounts", tag = "trainees", params(TraineeAccountsQuery),
    responses((status = OK, body = PageResponse<TraineeAccountResponse>)))]
pub async fn trainee_accounts(
    State(app): State<App>,
    by: Staff,
    Params(TraineeAccountsQuery { group }): Params<TraineeAccountsQuery>,
) -> HandlerResult<Json<PageResponse<TraineeAccountResponse>>> {
    if let Some(group) = group {
        app.store.groups().get(&by.scope, group).await.map_err(reference_problem("group"))?;
    }
    let accounts = app.store.invitations().accounts(&by.scope, group).await?;
    Ok(Json(PageResponse::whole(accounts.into_iter().map(TraineeAccountResponse::from))))
}

/// Trainees to invite.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewInvitations {
    /// The trainees, 1 to 500.
    invitations: Vec<NewInvitation>,
    /// Make links for trainees who have chosen a password, too, for example since they forgot it. Otherwise they are
    /// left out.
    #[serde(default)]
    also_with_password: bool,
}

/// A trainee to invite.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewInvitation {
    /// The trainee, by id or code.
    trainee: Key,
    /// The login, if the trainee has no account yet; by default it is the code, with a number if that is taken.
    login: Option<Login>,
}

/// An invitation with its secret, which no other answer contains.
#[derive(Serialize, ToSchema)]
pub struct MadeInvitation {
    trainee: Option<TraineeId>,
    name: Name,
    login: Login,
    /// The secret: the trainee opens `/choose-password#SECRET` of this service. It cannot be read again.
    secret: String,
    /// When the link expires.
    expires_at: Time,
}

impl MadeInvitation {
    /// The invitation with this account, link and secret.
    pub fn new(person: PersonRecord, link: &PasswordLinkRecord, secret: &Secret) -> Self {
        let PersonRecord { login, name, trainee_id, .. } = person;
        let expires_at = Time(link.expires_at_ms);
        Self { trainee: trainee_id, name, login, secret: secret.as_cookie(), expires_at }
    }
}

/// The invitations that were made.
#[derive(Serialize, ToSchema)]
pub struct MadeInvitations {
    /// In the order of the request.
    invitations: Vec<MadeInvitation>,
    /// Number of trainees who were left out, because they have chosen a password.
    left_out: usize,
}

/// Invite trainees
///
/// Makes the accounts of trainees who have none, and a link for each password. The trainee chooses the password with it.
/// A link for a first password is valid for 14 days, any other for 24 hours, unless the settings say otherwise. A new
/// link ends the trainee's earlier one; the present password stays valid until the link is used. A link ends when its
/// maker does not see the trainee any more. All invitations are made, or none. A token does not suffice.
#[utoipa::path(post, path = "/invitations", tag = "trainees", request_body = NewInvitations,
    responses((status = OK, body = MadeInvitations)))]
pub async fn invite(
    State(app): State<App>,
    BySignIn(by): BySignIn<Staff>,
    Json(NewInvitations { invitations, also_with_password }): Json<NewInvitations>,
) -> HandlerResult<Json<MadeInvitations>> {
    let count = invitations.len();
    if !(1..=MAX_INVITATIONS).contains(&count) {
        let why = format!("are {count}; expected 1 to {MAX_INVITATIONS}");
        return Err(ProblemResponse::invalid("invitations", why));
    }
    let secrets: Vec<Secret> = invitations.iter().map(|_| Secret::random()).collect();
    let invitees = invitations.into_iter().zip(&secrets);
    let invitees = invitees.map(|(NewInvitation { trainee, login }, secret)| {
        let secret = secret.hash();
        Invitee { trainee, login, secret }
    });
    let terms = app.invitation_terms(&by.scope, also_with_password).await?;
    let made = app.store.invitations().create(&by.scope, invitees.collect(), terms).await;
    match made.map_err(reference_problem("trainee"))? {
        Invitations::Made(made) => {
            let shown = made.into_iter().filter_map(|made| {
                let secret = secrets.get(made.index)?;
                Some(MadeInvitation::new(made.person, &made.link, secret))
            });
            let invitations: Vec<MadeInvitation> = shown.collect();
            Ok(Json(MadeInvitations { left_out: count - invitations.len(), invitations }))
        }
        Invitations::Refused(problems) => Err(invitation_problem(problems)),
    }
}

fn invitation_problem(problems: Vec<RowProblem>) -> ProblemResponse {
    let errors: Vec<FieldError> = problems
        .into_iter()
        .map(|RowProblem { row, field, message }| FieldError {
            field: format!("invitations[{}].{field}", row - 1),
            message,
        })
        .collect();
    let said: Vec<&str> = errors.iter().map(|error| error.message.as_str()).collect();
    let detail = format!("No trainee was invited. Correct this and send the list again: {}.", said.join(", "));
    Refusal::Invalid.with(detail).errors(errors)
}

impl App {
    /// The terms of invitations by this scope.
    pub(super) async fn invitation_terms(
        &self,
        scope: &Scope,
        also_with_password: bool,
    ) -> HandlerResult<InvitationTerms> {
        // All accounts of a request share the hash of one random password, which is thrown away.
        let place = self.password_hasher.take_place(HashRequester::Account(scope.actor()))?;
        Ok(InvitationTerms {
            no_password: place.unmatchable().await?,
            first: self.settings.invitation(),
            replacement: self.settings.password_link(),
            also_with_password,
        })
    }
}
