//! Scopes: what a caller may see and change. Every store function that touches personal data takes a [`Scope`].
//!
//! Code that has just authenticated the caller creates one from a cookie or token. [`Scope::service`] is for work that
//! the service does on its own behalf, and for the trainees of an agent's recordings ([`Scope::upload_scope`]). Data
//! outside the scope do not exist for the caller: the store answers "not found", never "not yours".

use std::fmt;

use super::role::Role;
use crate::ids::{BoxId, PersonId, TraineeId};

/// The right to see and change some of the centre's data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scope {
    reach: ScopeReach,
    actor: Actor,
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
        Self { reach: ScopeReach::Everything, actor: Actor::Person(person) }
    }

    /// An instructor: the trainees of their groups; boxes and tasks.
    pub fn instructor(person: PersonId) -> Self {
        Self { reach: ScopeReach::InstructorGroups(person), actor: Actor::Person(person) }
    }

    /// A trainee: themselves; boxes and tasks.
    pub fn trainee(person: PersonId, trainee: TraineeId) -> Self {
        Self { reach: ScopeReach::Trainee(trainee), actor: Actor::Person(person) }
    }

    /// The agent at a box: that box.
    pub fn agent(of: BoxId) -> Self {
        Self { reach: ScopeReach::Box(of), actor: Actor::Agent(of) }
    }

    /// The service itself: workers, recovery, the command line on the machine.
    pub fn service() -> Self {
        Self { reach: ScopeReach::Everything, actor: Actor::Service }
    }

    /// What this caller may read in the place of a trainee, who sees all of their own data. For administrators.
    pub fn on_behalf_of(&self, trainee: TraineeId) -> Self {
        let reach = if self.is_administrator() { ScopeReach::Trainee(trainee) } else { self.reach };
        Self { reach, actor: self.actor }
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
        Self { reach, actor: self.actor }
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

    /// True if the caller may change and erase boxes, tasks and trainees.
    pub fn is_staff(&self) -> bool {
        matches!(self.reach, ScopeReach::Everything | ScopeReach::InstructorGroups(_))
    }
}
