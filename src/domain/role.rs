//! What somebody is.

use super::named;

named! {
    /// What a signed-in person, or a program with a token, is.
    Role: "role" {
        /// Runs the centre: sees and changes everything.
        Administrator = "administrator",
        /// Teaches: sees the trainees of their groups.
        Instructor = "instructor",
        /// Trains: sees themselves.
        Trainee = "trainee",
        /// A program beside a box: feeds that box, nothing else. Never a person.
        Agent = "agent",
    }
}
