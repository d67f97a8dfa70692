//! Why the server closed a feed: codes of the range that WebSocket leaves to applications, and what to do about each.

/// Why a connection is closed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Farewell {
    /// What kind of reason.
    pub code: Code,
    /// What happened, for people; a close frame carries its first 120 bytes.
    pub why: String,
}

/// Kinds of reasons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// The recording is whole.
    Done,
    /// The service ends: come again in some seconds.
    Ending,
    /// A message that is not in the protocol, or not in its order.
    NotUnderstood,
    /// The sign-in has ended, or the token was withdrawn.
    SignedOut,
    /// A trainee or task that does not exist, or a recording that is not of this box.
    Unknown,
    /// The box sends another recording, or another sender sends this one: come again.
    Busy,
    /// A later connection sends this recording: stop.
    Superseded,
    /// A frame that is too large, or in too many pieces.
    TooMuch,
    /// A frame that does not belong: another epoch, time or order than was agreed.
    DoesNotBelong,
    /// Nothing came for too long.
    Silent,
    /// The server could not store it: come again.
    Failed,
}

impl Code {
    /// All of them.
    pub const ALL: [Code; 11] = [
        Code::Done,
        Code::Ending,
        Code::NotUnderstood,
        Code::SignedOut,
        Code::Unknown,
        Code::Busy,
        Code::Superseded,
        Code::TooMuch,
        Code::DoesNotBelong,
        Code::Silent,
        Code::Failed,
    ];

    /// The code of a close frame.
    pub fn number(self) -> u16 {
        match self {
            Code::Done => 1000,
            Code::Ending => 1012, // "service restart" (IANA)
            Code::NotUnderstood => 4400,
            Code::SignedOut => 4401,
            Code::Unknown => 4404,
            Code::Silent => 4408,
            Code::Busy => 4409,
            Code::Superseded => 4410,
            Code::TooMuch => 4413,
            Code::DoesNotBelong => 4422,
            Code::Failed => 4500,
        }
    }
}

impl Farewell {
    /// A reason of this kind.
    pub fn new(code: Code, why: impl Into<String>) -> Self {
        Self { code, why: why.into() }
    }

    /// The reason of a service that ends.
    pub fn service_ends() -> Self {
        Self::new(Code::Ending, "the service ends: come again in some seconds")
    }

    /// The reason of a sign-in that ends.
    pub fn signed_out() -> Self {
        Self::new(Code::SignedOut, "the sign-in has ended: sign in again")
    }

    /// As much of the reason as a close frame carries: 123 bytes.
    pub fn short(&self) -> &str {
        const MOST: usize = 123;
        let mut end = self.why.len().min(MOST);
        while !self.why.is_char_boundary(end) {
            end -= 1;
        }
        &self.why[..end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_reason_is_cut_between_letters() {
        let long = Farewell::new(Code::Failed, "ü".repeat(100));
        assert_eq!(long.short().len(), 122);
        assert_eq!(Farewell::new(Code::Done, "done").short(), "done");
    }
}
