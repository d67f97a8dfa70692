//! Enrols the trainees of a list: all of them or none. In the same transaction it makes the groups that are missing and
//! the accounts of the trainees, with links for their passwords.

use std::collections::HashMap;

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::error::StoreResult;
use super::invitations::{InvitationTerms, invite, is_taken as login_is_taken};
use super::password_links::PasswordLinkRecord;
use super::people::PersonRecord;
use super::trainees::{INSERT_GROUP_TRAINEE, SELECT_CODE, TraineeRecord, TraineeStore, insert};
use super::visibility::{BindScope, require_sign_in, require_staff};
use super::{Scope, codes, groups};
use crate::domain::enrolment::{CheckedEnrolment, ReadRow, ReadRows, RowProblem, row_problem};
use crate::domain::role::Role;
use crate::domain::secret::SecretHash;
use crate::domain::text::{Code, Name};
use crate::ids::{GroupId, TraineeId};

/// How a list is enrolled.
#[derive(Clone, Debug, Default)]
pub struct EnrolmentOptions {
    /// Only check the list.
    pub only_check: bool,
    /// Make the groups that do not exist. Otherwise a row that names one is refused.
    pub make_groups: bool,
    /// Invite the trainees. `None`: they get no accounts.
    pub invitations: Option<EnrolmentInvitations>,
}

/// Invitations of the trainees of a list.
#[derive(Clone, Debug)]
pub struct EnrolmentInvitations {
    /// What is common to them.
    pub terms: InvitationTerms,
    /// The hash of a secret for each row.
    pub secrets: Vec<SecretHash>,
}

/// A trainee who was enrolled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EnrolledTrainee {
    /// The trainee.
    pub trainee: TraineeRecord,
    /// Their account and the link for its password, if they were invited.
    pub invitation: Option<(PersonRecord, PasswordLinkRecord)>,
}

/// The outcome of enrolling or checking a list.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Enrolment {
    /// The enrolled trainees, in the order of the rows; empty if there are problems, or if the list was only checked.
    pub enrolled: Vec<EnrolledTrainee>,
    /// The problems of the rows. With any, nothing was changed.
    pub problems: Vec<RowProblem>,
    /// The groups that are made for the list, in the order of the rows.
    pub new_groups: Vec<Name>,
}

/// The group that a row's trainee joins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum JoinedGroup {
    None,
    Existing(GroupId),
    /// Place in the list of new groups.
    New(usize),
}

/// The groups of an enrolment.
struct EnrolmentGroups {
    /// The groups that the scope sees, by name.
    existing: HashMap<String, GroupId>,
    /// Those to make.
    new: Vec<Name>,
    may_make: bool,
    is_instructor: bool,
}

const SELECT_GROUPS_BY_NAME: &str = "
    SELECT name, id FROM training_group
    WHERE $1 = 'administrator'
      OR EXISTS (SELECT 1 FROM group_instructor WHERE group_id = training_group.id AND person_id = $2)";

const SELECT_GROUP_NAME: &str = "SELECT 1 FROM training_group WHERE name = $1";

impl TraineeStore<'_> {
    /// Enrols all trainees of a list in one transaction, or none. Rows name groups by their names, which must be in the
    /// scope or be new. An instructor's trainee joins one of the instructor's groups. The problems of the rows themselves
    /// are reported together with those that are found here.
    ///
    /// # Errors
    /// A program with a token invites trainees.
    pub async fn enrol(&self, scope: &Scope, read: ReadRows, options: EnrolmentOptions) -> StoreResult<Enrolment> {
        require_staff(scope, "registering trainees")?;
        if options.invitations.is_some() {
            require_sign_in(scope, "inviting trainees")?;
        }
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let mut groups = EnrolmentGroups::read(tx, &scope, options.make_groups).await?;
                let ReadRows { rows, mut problems } = read;
                let mut joins = Vec::with_capacity(rows.len());
                for (index, row) in rows.iter().enumerate() {
                    problems.extend(taken_problems(tx, index + 1, row, options.invitations.is_some()).await?);
                    match groups.choose(tx, row.group.as_deref()).await? {
                        Ok(group) => joins.push(group),
                        Err(why) => problems.push(row_problem(index + 1, "group", why)),
                    }
                }
                let new_groups = groups.new;
                if !problems.is_empty() || options.only_check {
                    problems.sort_by_key(|problem| problem.row);
                    return Ok(Enrolment { enrolled: Vec::new(), problems, new_groups });
                }
                let mut made = Vec::with_capacity(new_groups.len());
                for name in &new_groups {
                    made.push(groups::insert(tx, (&scope, now_ms), name).await?);
                }
                let group_of = |join: JoinedGroup| match join {
                    JoinedGroup::None => None,
                    JoinedGroup::Existing(id) => Some(id),
                    JoinedGroup::New(place) => made.get(place).copied(),
                };
                let joins = joins.into_iter().map(group_of).collect();
                let rows = rows.into_iter().filter_map(|row| row.trainee).collect(); // without problems, all of them
                let enrolled = enrol(tx, (&scope, now_ms), rows, joins, options.invitations).await?;
                Ok(Enrolment { enrolled, problems, new_groups })
            })
            .await
    }
}

async fn enrol(
    tx: &mut SqliteConnection,
    (scope, now_ms): (&Scope, i64),
    rows: Vec<CheckedEnrolment>,
    joins: Vec<Option<GroupId>>,
    invitations: Option<EnrolmentInvitations>,
) -> StoreResult<Vec<EnrolledTrainee>> {
    let mut trainees: Vec<(usize, TraineeRecord)> = Vec::with_capacity(rows.len());
    for index in given_first(&rows, |row| row.code.is_some()) {
        let row = &rows[index];
        let trainee = TraineeRecord {
            id: TraineeId::at(now_ms),
            code: codes::choose(tx, SELECT_CODE, row.code.clone(), &row.name, "trainee").await?,
            name: row.name.clone(),
            level: row.level,
            handedness: row.handedness,
            created_at_ms: now_ms,
            is_in_several_groups: false,
        };
        insert(tx, &trainee).await?;
        if let Some(group) = joins[index] {
            sqlx::query(INSERT_GROUP_TRAINEE).bind(group).bind(trainee.id).execute(&mut *tx).await?;
        }
        note(tx, scope, now_ms, ("create", "trainee"), trainee.id).await?;
        trainees.push((index, trainee));
    }
    trainees.sort_by_key(|(index, _)| *index);
    let mut enrolled: Vec<EnrolledTrainee> =
        trainees.into_iter().map(|(_, trainee)| EnrolledTrainee { trainee, invitation: None }).collect();
    let Some(EnrolmentInvitations { terms, secrets }) = invitations else { return Ok(enrolled) };
    for index in given_first(&rows, |row| row.login.is_some()) {
        let Some(secret) = secrets.get(index).copied() else { continue };
        let wanted = (rows[index].login.clone(), secret);
        enrolled[index].invitation = invite(tx, (scope, now_ms), &enrolled[index].trainee, wanted, &terms).await?;
    }
    Ok(enrolled)
}

/// The places of the rows: first those that state a code or login, so that derived ones use what is left.
fn given_first(rows: &[CheckedEnrolment], is_given: fn(&CheckedEnrolment) -> bool) -> Vec<usize> {
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by_key(|index| !is_given(&rows[*index]));
    order
}

/// The problems of a row whose code or login is taken. Both are unique in the centre; the caller does not learn whose
/// they are.
async fn taken_problems(
    tx: &mut SqliteConnection,
    row: usize,
    of: &ReadRow,
    makes_accounts: bool,
) -> StoreResult<Vec<RowProblem>> {
    let mut problems = Vec::new();
    if let Some(code) = &of.code
        && code_is_taken(tx, code).await?
    {
        problems.push(row_problem(row, "code", format!("`{code}` is already taken; choose another")));
    }
    if let Some(login) = of.login.as_ref().filter(|_| makes_accounts)
        && login_is_taken(tx, login).await?
    {
        problems.push(row_problem(row, "login", format!("`{login}` is already taken; choose another")));
    }
    Ok(problems)
}

async fn code_is_taken(tx: &mut SqliteConnection, code: &Code) -> StoreResult<bool> {
    let found: Option<i64> = sqlx::query_scalar(SELECT_CODE).bind(code).fetch_optional(tx).await?;
    Ok(found.is_some())
}

impl EnrolmentGroups {
    /// The groups that the scope sees.
    async fn read(tx: &mut SqliteConnection, scope: &Scope, may_make: bool) -> StoreResult<Self> {
        let rows = sqlx::query_as::<_, (String, GroupId)>(SELECT_GROUPS_BY_NAME);
        let existing = rows.bind_scope(scope).fetch_all(tx).await?.into_iter().collect();
        Ok(Self { existing, new: Vec::new(), may_make, is_instructor: scope.role() == Role::Instructor })
    }

    /// The group of a row: the named one, which may be new. Without a name it is an instructor's only group; for
    /// administrators it is none. `Err`: why the row cannot be used.
    async fn choose(
        &mut self,
        tx: &mut SqliteConnection,
        named: Option<&str>,
    ) -> StoreResult<Result<JoinedGroup, String>> {
        let Some(name) = named else { return Ok(self.without_name()) };
        if let Some(group) = self.existing.get(name) {
            return Ok(Ok(JoinedGroup::Existing(*group)));
        }
        if !self.may_make {
            return Ok(Err(format!("you have no group called `{name}`: create it first, or correct the name")));
        }
        if let Some(place) = self.new.iter().position(|new| new.as_str() == name) {
            return Ok(Ok(JoinedGroup::New(place)));
        }
        let new = match name.parse::<Name>() {
            Ok(new) => new,
            Err(invalid) => return Ok(Err(invalid.why)),
        };
        let found: Option<i64> = sqlx::query_scalar(SELECT_GROUP_NAME).bind(&new).fetch_optional(tx).await?;
        if found.is_some() {
            return Ok(Err(format!(
                "`{name}` is a group of other instructors: choose another name, or ask an administrator to add you to it"
            )));
        }
        self.new.push(new);
        Ok(Ok(JoinedGroup::New(self.new.len() - 1)))
    }

    fn without_name(&self) -> Result<JoinedGroup, String> {
        let mut own = self.existing.values();
        match (self.is_instructor, own.next(), own.next()) {
            (false, ..) => Ok(JoinedGroup::None),
            (true, Some(only), None) => Ok(JoinedGroup::Existing(*only)),
            (true, None, _) => Err("is missing: you teach no group yet, so name one to make".to_owned()),
            (true, Some(_), Some(_)) => Err("is missing: you teach several groups, so name the one to join".to_owned()),
        }
    }
}
