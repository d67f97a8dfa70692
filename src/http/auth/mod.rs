//! Who asks, and what that lets them do.
//!
//! People sign in with a cookie, programs send a token; [`signed_in`] turns either into a scope, and nothing else does.

pub mod origin;
pub mod password;
pub mod presented;
pub mod sign_in;
pub mod signed_in;
pub mod throttle;
