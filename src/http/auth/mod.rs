//! Who is calling, and what they may do.
//!
//! People sign in and send a cookie, programs send a token. [`signed_in`] alone turns either into a scope.

pub mod open_sign_ins;
pub mod origin;
pub mod password;
pub mod presented;
pub mod sign_in;
pub mod signed_in;
pub mod throttle;
