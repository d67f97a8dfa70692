//! What somebody may see and change. Every function of the store that touches people's data asks for a [`Scope`].
//!
//! Only code that has just proved who is asking makes one: the sign-in extractor from a cookie or token, and
//! [`Scope::service`] for work that the service does on its own behalf. What a scope does not cover does not exist for
//! its holder: the store answers "not found", never "not yours".

use super::role::Role;
use crate::ids::{BoxId, PersonId, TraineeId};

/// The right to see and change some of the centre's data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scope {
    reach: Reach,
    actor: Actor,
}

/// How far somebody sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reach {
    Everything,
    GroupsOf(PersonId),
    Trainee(TraineeId),
    Box(BoxId),
}

/// Who is asking, for the audit trail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Actor {
    /// A person, by cookie or by a token of theirs.
    Person(PersonId),
    /// The program beside a box.
    Agent(BoxId),
    /// The service itself.
    Service,
}

impl Scope {
    /// An administrator: everything.
    pub fn administrator(person: PersonId) -> Self {
        Self { reach: Reach::Everything, actor: Actor::Person(person) }
    }

    /// An instructor: the trainees of their groups; boxes and tasks.
    pub fn instructor(person: PersonId) -> Self {
        Self { reach: Reach::GroupsOf(person), actor: Actor::Person(person) }
    }

    /// A trainee: themselves; boxes and tasks.
    pub fn trainee(person: PersonId, trainee: TraineeId) -> Self {
        Self { reach: Reach::Trainee(trainee), actor: Actor::Person(person) }
    }

    /// The program beside a box: that box.
    pub fn agent(of: BoxId) -> Self {
        Self { reach: Reach::Box(of), actor: Actor::Agent(of) }
    }

    /// The service itself: workers, recovery, the command line on the machine.
    pub fn service() -> Self {
        Self { reach: Reach::Everything, actor: Actor::Service }
    }

    /// The role whose rights this scope carries.
    pub fn role(&self) -> Role {
        match self.reach {
            Reach::Everything => Role::Administrator,
            Reach::GroupsOf(_) => Role::Instructor,
            Reach::Trainee(_) => Role::Trainee,
            Reach::Box(_) => Role::Agent,
        }
    }

    /// The id that limits the role: the instructor's, the trainee's or the box's.
    pub fn subject(&self) -> Option<String> {
        match self.reach {
            Reach::Everything => None,
            Reach::GroupsOf(person) => Some(person.to_string()),
            Reach::Trainee(trainee) => Some(trainee.to_string()),
            Reach::Box(of) => Some(of.to_string()),
        }
    }

    /// The trainee who is asking, if it is one.
    pub fn own_trainee(&self) -> Option<TraineeId> {
        match self.reach {
            Reach::Trainee(trainee) => Some(trainee),
            Reach::Everything | Reach::GroupsOf(_) | Reach::Box(_) => None,
        }
    }

    /// The scope of those whose recordings it may send: a box's agent sends whoever sits in front of it, people send only
    /// whom they see.
    pub fn of_whom_it_sends(&self) -> Self {
        if self.role() == Role::Agent { Self::service() } else { self.clone() }
    }

    /// Who is asking.
    pub fn actor(&self) -> Actor {
        self.actor
    }

    /// The person who is asking, if it is one.
    pub fn person(&self) -> Option<PersonId> {
        match self.actor {
            Actor::Person(person) => Some(person),
            Actor::Agent(_) | Actor::Service => None,
        }
    }

    /// May it run the centre: people, tokens, groups?
    pub fn is_administrator(&self) -> bool {
        self.reach == Reach::Everything
    }

    /// May it change boxes, tasks and trainees, and erase?
    pub fn is_staff(&self) -> bool {
        matches!(self.reach, Reach::Everything | Reach::GroupsOf(_))
    }
}
