//! Why the box does not do what was asked of it. The box's screen has a text for each kind in its own language; the words
//! here are for the server and the log.

/// Why a start, a stop or a check-in at the box is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BoxRefusal {
    /// The button for a recording without a name was pressed, and a trainee is checked in.
    #[error("a trainee has checked in meanwhile: press Start")]
    CheckedIn,
    /// No task is chosen.
    #[error("choose a task first")]
    NoTask,
    /// The person at the box may be one who does not consent.
    #[error("check in first, or press the button Record without a name: the last check-in was ended or refused")]
    NeedsButton,
    /// The box makes no recordings without a name.
    #[error("check in first: this box makes no recordings without a name")]
    NeedsCheckIn,
    /// A recording is running.
    #[error("a recording is running already")]
    Running,
    /// There is no recording to stop.
    #[error("no recording is running")]
    NotRunning,
    /// What was to be stopped has ended, and the box may do something else now.
    #[error("what was to be stopped has ended meanwhile; press Stop again if what the box does now is to end")]
    StopTooLate,
    /// The recording was stopped already.
    #[error("the recording is ending: its last frames are being written")]
    Ending,
    /// The camera is not there.
    #[error("the camera is missing")]
    CameraMissing,
    /// The disk or the spool has no space for a recording.
    #[error("there is no space for a recording ({0}): free space on the computer of the box")]
    NoSpace(String),
    /// The disk fails.
    #[error("the spool cannot be written ({0}): look at the disk of the box's computer")]
    Disk(String),
    /// A recording that begins with a movement has a name.
    #[error("check in first: a recording without a name does not begin by itself")]
    MovementNeedsCheckIn,
    /// A movement cannot be found in the pictures of the camera.
    #[error("the pictures of the camera cannot be read ({0})")]
    Pictures(String),
    /// The server cannot be asked now.
    #[error("no connection to the server: check in when it is back")]
    NotConnected,
}

impl BoxRefusal {
    /// Its name, for the texts of the screen.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::CheckedIn => "checked-in",
            Self::NoTask => "no-task",
            Self::NeedsButton => "needs-button",
            Self::NeedsCheckIn => "needs-check-in",
            Self::Running => "running",
            Self::NotRunning => "not-running",
            Self::StopTooLate => "stop-too-late",
            Self::Ending => "ending",
            Self::CameraMissing => "camera-missing",
            Self::NoSpace(_) => "no-space",
            Self::Disk(_) => "disk",
            Self::MovementNeedsCheckIn => "movement-needs-check-in",
            Self::Pictures(_) => "pictures",
            Self::NotConnected => "not-connected",
        }
    }

    /// What the system says, which has no translation.
    pub fn detail(&self) -> Option<&str> {
        match self {
            Self::NoSpace(why) | Self::Disk(why) | Self::Pictures(why) => Some(why),
            _ => None,
        }
    }

    /// The spool cannot be written.
    pub(super) fn of_disk(error: &std::io::Error) -> Self {
        match crate::capture::spool::is_disk_full(error) {
            true => Self::NoSpace(error.to_string()),
            false => Self::Disk(error.to_string()),
        }
    }
}

/// A refusal as the screen gets it.
#[derive(Clone, Debug, serde::Serialize)]
pub struct ShownRefusal {
    /// Its name, for the texts of the screen.
    pub kind: &'static str,
    /// What the system says.
    pub detail: Option<String>,
    /// All of it in English.
    pub why: String,
}

impl From<&BoxRefusal> for ShownRefusal {
    fn from(why: &BoxRefusal) -> Self {
        Self { kind: why.kind(), detail: why.detail().map(str::to_owned), why: why.to_string() }
    }
}

/// Why the camera is missing, as a name that the screen has a text for. FFmpeg passes the system's words on.
pub(super) fn camera_fault(why: &str) -> &'static str {
    let says = |words: &str| why.contains(words);
    match () {
        () if says("Permission denied") || says("Operation not permitted") => "not-allowed",
        () if says("resource busy") => "busy",
        () if says("sent nothing") => "silent",
        () if says("Invalid argument") || says("Not a typewriter") || says("Inappropriate ioctl") => "settings",
        () => "missing",
    }
}

#[cfg(test)]
mod tests {
    use std::io::Error;

    use super::*;

    #[test]
    fn the_fault_of_a_camera_is_named_by_the_words_of_the_system() {
        for (number, fault) in [
            (libc::EACCES, "not-allowed"),
            (libc::EPERM, "not-allowed"),
            (libc::EBUSY, "busy"),
            (libc::EINVAL, "settings"),
            (libc::ENOTTY, "settings"),
            (libc::ENOENT, "missing"),
            (libc::ENODEV, "missing"),
        ] {
            let error = Error::from_raw_os_error(number);
            assert_eq!(camera_fault(&format!("the source cannot be opened ({error})")), fault, "{error}");
        }
        assert_eq!(camera_fault("the camera sent nothing for 5s"), "silent");
        assert_eq!(camera_fault("the source ended"), "missing");
    }
}
