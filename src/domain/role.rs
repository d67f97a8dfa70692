//! Roles of users and agents.

use super::named;

named! {
    /// The role of a signed-in person, or of a program with a token.
    Role: "role" {
        /// Runs the centre: may see and change everything.
        Administrator = "administrator",
        /// Teaches: may see the trainees of their groups.
        Instructor = "instructor",
        /// Trains: may see only their own data.
        Trainee = "trainee",
        /// A program at a box: sends that box's recordings, nothing else. Never a person.
        Agent = "agent",
    }
}
