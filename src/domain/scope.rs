//! Scopes: what a caller may see and change. Every store function that touches personal data takes a [`Scope`].
//!
//! Code that has just authenticated the caller creates one from a cookie or token. [`Scope::service`] is for work that
//! the service does on its own behalf, and for the trainees of an agent's recordings ([`Scope::upload_scope`]). Data
//! outside the scope do not exist for the caller: the store answers "not found", never "not yours".

use core::net::IpAddr; // a value only: `core` has no network
use std::fmt;

use super::rights::RightsSettings;
use super::role::Role;
use crate::ids::{BoxId, GroupId, PersonId, TokenId, TraineeId};

/// The right to see and change some of the centre's data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scope {
    reach: ScopeReach,
    actor: Actor,
    rights: RightsSettings,
    token: Option<CallingToken>,
    address: Option<IpAddr>,
}

/// The token that a program calls with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CallingToken {
    /// Its id.
    pub id: TokenId,
    /// When it expires, epoch ms; `None` if it never does.
    pub expires_at_ms: Option<i64>,
}

/// The data that a scope covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ScopeReach {
    Everything,
    InstructorGroups(PersonId),
    Trainee(TraineeId),
    Box(BoxId),
}

/// The caller, for the audit trail. As text: `person:ID`, `agent:BOX` or `service`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Actor {
    /// A person, signed in by cookie or token.
    Person(PersonId),
    /// The agent at a box.
    Agent(BoxId),
    /// The service itself.
    Service,
}

impl fmt::Display for Actor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Actor::Person(person) => write!(f, "person:{person}"),
            Actor::Agent(of) => write!(f, "agent:{of}"),
            Actor::Service => f.write_str("service"),
        }
    }
}

impl Scope {
    /// An administrator: everything.
    pub fn administrator(person: PersonId) -> Self {
        Self::new(ScopeReach::Everything, Actor::Person(person))
    }

    /// An instructor: the trainees of their groups; boxes and tasks.
    pub fn instructor(person: PersonId) -> Self {
        Self::new(ScopeReach::InstructorGroups(person), Actor::Person(person))
    }

    /// A trainee: themselves; boxes and tasks.
    pub fn trainee(person: PersonId, trainee: TraineeId) -> Self {
        Self::new(ScopeReach::Trainee(trainee), Actor::Person(person))
    }

    /// The agent at a box: that box.
    pub fn agent(of: BoxId) -> Self {
        Self::new(ScopeReach::Box(of), Actor::Agent(of))
    }

    /// The service itself: workers, recovery, the command line on the machine.
    pub fn service() -> Self {
        Self::new(ScopeReach::Everything, Actor::Service)
    }

    fn new(reach: ScopeReach, actor: Actor) -> Self {
        Self { reach, actor, rights: RightsSettings::default(), token: None, address: None }
    }

    /// The same scope for a program that calls with this token.
    pub fn by_token(self, token: CallingToken) -> Self {
        Self { token: Some(token), ..self }
    }

    /// The token that the caller sent; `None` for a person who has signed in, and for the service.
    pub fn token(&self) -> Option<CallingToken> {
        self.token
    }

    /// The same scope for a request of the client with this address.
    pub fn at_address(self, address: IpAddr) -> Self {
        Self { address: Some(address), ..self }
    }

    /// The address of the client that sent the request, for the audit trail; `None` without a request.
    pub fn address(&self) -> Option<IpAddr> {
        self.address
    }

    /// The same scope with what the settings allow instructors.
    pub fn with_rights(self, rights: RightsSettings) -> Self {
        Self { rights, ..self }
    }

    /// The role whose rights this scope carries.
    pub fn role(&self) -> Role {
        match self.reach {
            ScopeReach::Everything => Role::Administrator,
            ScopeReach::InstructorGroups(_) => Role::Instructor,
            ScopeReach::Trainee(_) => Role::Trainee,
            ScopeReach::Box(_) => Role::Agent,
        }
    }

    /// The id of the instructor, trainee or box that limits the scope; `None` for unlimited scopes.
    pub fn subject(&self) -> Option<String> {
        match self.reach {
            ScopeReach::Everything => None,
            ScopeReach::InstructorGroups(person) => Some(person.to_string()),
            ScopeReach::Trainee(trainee) => Some(trainee.to_string()),
            ScopeReach::Box(of) => Some(of.to_string()),
        }
    }

    /// The caller's trainee id, if the caller is a trainee.
    pub fn own_trainee(&self) -> Option<TraineeId> {
        match self.reach {
            ScopeReach::Trainee(trainee) => Some(trainee),
            ScopeReach::Everything | ScopeReach::InstructorGroups(_) | ScopeReach::Box(_) => None,
        }
    }

    /// The scope for uploads: a box's agent may send recordings of any trainee, a person only of trainees in their own
    /// scope.
    pub fn upload_scope(&self) -> Self {
        let reach = if self.role() == Role::Agent { ScopeReach::Everything } else { self.reach };
        Self { reach, ..self.clone() }
    }

    /// True for the service's own work, which also sees the people who wait for their erasure.
    pub fn is_service(&self) -> bool {
        self.actor == Actor::Service
    }

    /// The caller.
    pub fn actor(&self) -> Actor {
        self.actor
    }

    /// The calling person, if the caller is a person.
    pub fn person(&self) -> Option<PersonId> {
        match self.actor {
            Actor::Person(person) => Some(person),
            Actor::Agent(_) | Actor::Service => None,
        }
    }

    /// True if the caller may manage people, tokens and groups.
    pub fn is_administrator(&self) -> bool {
        self.reach == ScopeReach::Everything
    }

    /// True if the caller is an administrator or an instructor.
    pub fn is_staff(&self) -> bool {
        matches!(self.reach, ScopeReach::Everything | ScopeReach::InstructorGroups(_))
    }

    /// True if the caller may change a box, a task or a course plan. `owners` are those of its groups that the scope
    /// sees.
    pub fn may_change(&self, owners: &[GroupId]) -> bool {
        match self.reach {
            ScopeReach::Everything => true,
            ScopeReach::InstructorGroups(_) => self.rights.instructors_edit_all || !owners.is_empty(),
            ScopeReach::Trainee(_) | ScopeReach::Box(_) => false,
        }
    }

    /// True if the caller may erase a trainee that the scope sees.
    pub fn may_erase_trainee(&self, is_in_several_groups: bool) -> bool {
        match self.reach {
            ScopeReach::Everything => true,
            ScopeReach::InstructorGroups(_) => self.rights.instructors_erase_shared || !is_in_several_groups,
            ScopeReach::Trainee(_) | ScopeReach::Box(_) => false,
        }
    }

    /// True if the caller may make boxes, tasks and course plans that no group owns.
    pub fn may_make_unowned(&self) -> bool {
        self.may_change(&[])
    }
}
