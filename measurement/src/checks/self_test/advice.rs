//! What to do about a part of the self-test that is not green: a closed list, so that pages can translate it.

/// What to do about a part of the self-test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelfTestAdvice {
    /// Touch the corners as the test needs it.
    HoldStill,
    /// Compare the rod with its entry.
    CheckRod,
    /// Touch the corners again.
    RepeatTouches,
    /// Calibrate the camera again.
    Recalibrate,
    /// Show the board without a tool.
    ShowBoard,
    /// Find out whether the camera or only the port differs.
    CheckPort,
    /// Remove what has the tape's colour.
    ClearBox,
    /// Mark the tapes.
    MarkTapes,
    /// Mark the tapes in today's light.
    MarkInLight,
    /// Show the board without tools and hands.
    ClearView,
    /// Keep exposure and light constant.
    HoldLight,
    /// Light the box.
    SwitchLightOn,
}

impl SelfTestAdvice {
    /// Every advice.
    pub const ALL: [SelfTestAdvice; 12] = [
        SelfTestAdvice::HoldStill,
        SelfTestAdvice::CheckRod,
        SelfTestAdvice::RepeatTouches,
        SelfTestAdvice::Recalibrate,
        SelfTestAdvice::ShowBoard,
        SelfTestAdvice::CheckPort,
        SelfTestAdvice::ClearBox,
        SelfTestAdvice::MarkTapes,
        SelfTestAdvice::MarkInLight,
        SelfTestAdvice::ClearView,
        SelfTestAdvice::HoldLight,
        SelfTestAdvice::SwitchLightOn,
    ];

    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            SelfTestAdvice::HoldStill => "hold_still",
            SelfTestAdvice::CheckRod => "check_rod",
            SelfTestAdvice::RepeatTouches => "repeat_touches",
            SelfTestAdvice::Recalibrate => "recalibrate",
            SelfTestAdvice::ShowBoard => "show_board",
            SelfTestAdvice::CheckPort => "check_port",
            SelfTestAdvice::ClearBox => "clear_box",
            SelfTestAdvice::MarkTapes => "mark_tapes",
            SelfTestAdvice::MarkInLight => "mark_in_light",
            SelfTestAdvice::ClearView => "clear_view",
            SelfTestAdvice::HoldLight => "hold_light",
            SelfTestAdvice::SwitchLightOn => "switch_light_on",
        }
    }

    /// The advice in words, without a full stop.
    pub fn words(self) -> &'static str {
        match self {
            SelfTestAdvice::HoldStill => {
                "hold the end of the rod still on six corners of the board, 2 s on each, and do not move the board"
            }
            SelfTestAdvice::CheckRod => {
                "all touches are off to the same side in depth: check that the rod's diameter is the one entered with \
                 the box's colours, and if it has tape, also the tape's length, and that the tape ends at the rod's \
                 end; then calibrate the camera again"
            }
            SelfTestAdvice::RepeatTouches => {
                "repeat the touches carefully; if the error stays, calibrate the camera again with about 20 photos"
            }
            SelfTestAdvice::Recalibrate => {
                "check whether the camera's zoom, focus or picture size was changed, then calibrate the camera again"
            }
            SelfTestAdvice::ShowBoard => {
                "put the board used for the calibration fully into view, and leave it for 3 s without a tool in view"
            }
            SelfTestAdvice::CheckPort => {
                "if the rod went through a different port than the tools, this is fine; otherwise the camera was \
                 moved since its calibration: put it back"
            }
            SelfTestAdvice::ClearBox => {
                "take everything that has the tape's colour out of the box, and keep the light as it was; if this \
                 does not help, mark the tapes again or use tape of another colour (`trocar palette --advise`)"
            }
            SelfTestAdvice::MarkTapes => "mark the tapes again",
            SelfTestAdvice::MarkInLight => {
                "mark the tapes again in today's light; if this does not help, use tape of another colour (`trocar \
                 palette --advise`)"
            }
            SelfTestAdvice::ClearView => "put the board into view, and keep tools and hands out of the picture for 3 s",
            SelfTestAdvice::HoldLight => {
                "switch off the camera's automatic exposure and white balance, and keep daylight out of the box"
            }
            SelfTestAdvice::SwitchLightOn => "switch on the light of the box",
        }
    }
}
