//! Why the server closed a feed: close codes, mostly from WebSocket's range for applications, and what to do about
//! each.

/// Why a connection is closed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CloseReason {
    /// The close code.
    pub code: CloseCode,
    /// What happened, for people; a close frame carries its first 123 bytes.
    pub why: String,
}

/// Close codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CloseCode {
    /// The recording is complete.
    Done,
    /// The service is stopping: reconnect in a few seconds.
    ServiceStopping,
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
    TooLarge,
    /// A frame with a wrong epoch, time or order.
    OutOfPlace,
    /// Nothing was received for too long.
    Silent,
    /// The server could not store the recording: reconnect later.
    Failed,
}

impl CloseCode {
    /// All close codes.
    pub const ALL: [CloseCode; 11] = [
        CloseCode::Done,
        CloseCode::ServiceStopping,
        CloseCode::NotUnderstood,
        CloseCode::SignedOut,
        CloseCode::Unknown,
        CloseCode::Busy,
        CloseCode::Superseded,
        CloseCode::TooLarge,
        CloseCode::OutOfPlace,
        CloseCode::Silent,
        CloseCode::Failed,
    ];

    /// The code number in the close frame.
    pub fn number(self) -> u16 {
        match self {
            CloseCode::Done => 1000,
            CloseCode::ServiceStopping => 1012, // "service restart" (IANA)
            CloseCode::NotUnderstood => 4400,
            CloseCode::SignedOut => 4401,
            CloseCode::Unknown => 4404,
            CloseCode::Silent => 4408,
            CloseCode::Busy => 4409,
            CloseCode::Superseded => 4410,
            CloseCode::TooLarge => 4413,
            CloseCode::OutOfPlace => 4422,
            CloseCode::Failed => 4500,
        }
    }
}

impl CloseReason {
    /// A reason with this code.
    pub fn new(code: CloseCode, why: impl Into<String>) -> Self {
        Self { code, why: why.into() }
    }

    /// The service is stopping.
    pub fn service_stopping() -> Self {
        Self::new(CloseCode::ServiceStopping, "the service is stopping: reconnect in a few seconds")
    }

    /// The sign-in has ended.
    pub fn signed_out() -> Self {
        Self::new(CloseCode::SignedOut, "the sign-in has ended: sign in again")
    }

    /// The reason, cut to the 123 bytes that fit into a close frame.
    pub fn truncated(&self) -> &str {
        const MAX_BYTES: usize = 123;
        let mut end = self.why.len().min(MAX_BYTES);
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
        let long = CloseReason::new(CloseCode::Failed, "ü".repeat(100));
        assert_eq!(long.truncated().len(), 122);
        assert_eq!(CloseReason::new(CloseCode::Done, "done").truncated(), "done");
    }
}
