//! Why the server closed a feed: close codes, mostly from WebSocket's range for applications, and what to do about
//! each.

/// Why a connection is closed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Farewell {
    /// The close code.
    pub code: Code,
    /// What happened, for people; a close frame carries its first 123 bytes.
    pub why: String,
}

/// Close codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// The recording is complete.
    Done,
    /// The service is stopping: reconnect in a few seconds.
    Ending,
    /// A message that is not part of the protocol, or at the wrong time.
    NotUnderstood,
    /// The sign-in has ended, or the token was revoked.
    SignedOut,
    /// An unknown trainee or task, or a recording of another box.
    Unknown,
    /// The box is sending another recording, or another sender is sending this one: reconnect later.
    Busy,
    /// A later connection has taken over this recording: do not reconnect.
    Superseded,
    /// A frame is too large, or the frame numbers are in too many pieces.
    TooMuch,
    /// A frame with a wrong epoch, time or order.
    DoesNotBelong,
    /// Nothing was received for too long.
    Silent,
    /// The server could not store the recording: reconnect later.
    Failed,
}

impl Code {
    /// All close codes.
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

    /// The code number in the close frame.
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
    /// A reason with this code.
    pub fn new(code: Code, why: impl Into<String>) -> Self {
        Self { code, why: why.into() }
    }

    /// The service is stopping.
    pub fn service_ends() -> Self {
        Self::new(Code::Ending, "the service is stopping: reconnect in a few seconds")
    }

    /// The sign-in has ended.
    pub fn signed_out() -> Self {
        Self::new(Code::SignedOut, "the sign-in has ended: sign in again")
    }

    /// The reason, cut to the 123 bytes that fit into a close frame.
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
