//! Which replies about a live recording an honest child may send.

use super::{FollowReply, FollowWork, FollowedFrame, FollowedTool, RunningRow, SeenSoFar};
use crate::analysis::child::ChildEvent;
use crate::analysis::child::limits::{is_plausible_number, is_plausible_row, is_small_jpeg};
use crate::analysis::child::track::is_plausible_light;
use crate::domain::feed::MAX_FRAMES;
use crate::media::MediaLimits;
use crate::motion::features::running::LIVE_FEATURES;
use crate::motion::quality::ports::watch::ConfirmedPlacement;
use crate::motion::quality::{MovedDuring, QualityCause};
use crate::vision::tracker::ToolSpec;

/// Most frames in one reply about a feed: those that a decoder held back, or those of the warm-up.
const MAX_FRAMES_PER_REPLY: u64 = 64;

/// Number and time of the last frame that was tracked. Replies are passed on at once.
#[derive(Debug, Default)]
pub struct FollowOutput {
    last_frame: Option<(u64, f64)>,
}

/// Passes on a reply.
pub(super) fn accept(
    work: &FollowWork,
    followed: FollowReply,
    output: &mut FollowOutput,
    limits: MediaLimits,
) -> Result<ChildEvent, String> {
    let tools = work.track.tools.len();
    for frame in &followed.frames {
        let is_later = output.last_frame.is_none_or(|(number, time_s)| frame.frame != number && frame.time_s > time_s);
        let in_time = (0.0..=limits.duration_s).contains(&frame.time_s);
        let are_tools = frame.tools.len() == tools
            && frame.tools.iter().enumerate().all(|(index, tool)| belongs_to_frame(tool, frame, index as u32));
        if !(is_later && in_time && are_tools && frame.frame < MAX_FRAMES) {
            return Err("an invalid frame of a feed".into());
        }
        output.last_frame = Some((frame.frame, frame.time_s));
    }
    let is_running = |row: &RunningRow| {
        (row.tool as usize) < tools
            && (row.feature as usize) < LIVE_FEATURES.len()
            && row.value.is_none_or(is_plausible_number)
    };
    let consistent = followed.frames.len() as u64 <= MAX_FRAMES_PER_REPLY
        && followed.running.iter().flatten().count() <= tools * LIVE_FEATURES.len()
        && followed.running.iter().flatten().all(is_running)
        && followed.light.iter().all(is_plausible_light)
        && followed.seen.iter().all(|seen| are_plausible_shares(seen, tools))
        && (!followed.is_learning_box || work.track.tools.iter().any(ToolSpec::is_bare))
        && followed.placement.iter().all(|placement| is_plausible_placement(placement, tools))
        && followed.moved_during.is_none_or(|moved| is_plausible_movement(&moved, limits))
        && followed.picture.as_ref().is_none_or(|(_, jpeg)| is_small_jpeg(jpeg));
    if consistent { Ok(ChildEvent::Followed(followed)) } else { Err("an invalid reply about a feed".into()) }
}

fn are_plausible_shares(seen: &[SeenSoFar], tools: usize) -> bool {
    let is_known = |seen: &SeenSoFar| seen.worst.is_none_or(|worst| (worst.cause as usize) < QualityCause::ALL.len());
    let is_share = |seen: &SeenSoFar| seen.coverage.is_none_or(|share| (0.0..=1.0).contains(&share));
    seen.len() == tools
        && seen.iter().all(|seen| is_known(seen) && is_share(seen) && seen.numbers().all(is_plausible_number))
}

fn is_plausible_placement(placement: &ConfirmedPlacement, tools: usize) -> bool {
    let shifts = placement.ports.iter().chain([&placement.camera]).flatten();
    placement.ports.len() == tools && shifts.flat_map(|shift| [shift.mm, shift.sigma_mm]).all(is_plausible_number)
}

fn is_plausible_movement(moved: &MovedDuring, limits: MediaLimits) -> bool {
    is_plausible_number(moved.mm) && moved.mm >= 0.0 && (0.0..=limits.duration_s).contains(&moved.at_s)
}

/// True if the tool's rows belong to this frame.
fn belongs_to_frame(tool: &FollowedTool, frame: &FollowedFrame, index: u32) -> bool {
    let FollowedTool { seen, path, .. } = tool;
    (seen.frame, seen.tool) == (frame.frame, index)
        && seen.numbers().all(|x| is_plausible_number(x.into()))
        && path.is_none_or(|row| {
            (row.frame, row.tool, row.time_s) == (frame.frame, index as usize, frame.time_s) && is_plausible_row(&row)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::follow::LiveConcern;
    use crate::analysis::child::track::tests::settings;
    use crate::analysis::child::{ChildWork, WorkRecord};
    use crate::analysis::output_validator::validate_records;
    use crate::analysis::protocol::SeenRow;
    use crate::domain::feed::FrameCodec;
    use crate::motion::quality::ports::{Displacement, Ports};
    use crate::vision::tracker::{LightSample, Marker, TrackerSettings};

    fn reply(frame: u64, time_s: f64) -> FollowReply {
        let seen = SeenRow { frame, tool: 0, reason: None, borders_px: None, tip_px: None };
        let tools = vec![FollowedTool { seen, path: None, left_view: false }];
        FollowReply { frames: vec![FollowedFrame { frame, time_s, tools }], ..FollowReply::default() }
    }

    fn validate(replies: Vec<FollowReply>) -> Result<(), String> {
        validate_for(settings(), replies)
    }

    fn validate_for(track: TrackerSettings, replies: Vec<FollowReply>) -> Result<(), String> {
        let (time_base, ports) = ([1, 1000].try_into().unwrap(), Ports::default());
        let work = FollowWork { track, codec: FrameCodec::Jpeg, size: (640, 480), time_base, ports };
        validate_records(&ChildWork::Follow(work), replies.into_iter().map(WorkRecord::Follow).collect()).map(drop)
    }

    #[test]
    fn frames_follow_each_other_and_have_every_tool() {
        assert!(validate(vec![reply(4, 0.1), reply(5, 0.2)]).is_ok());
        assert!(validate(vec![reply(4, 0.1), reply(4, 0.2)]).is_err());
        assert!(validate(vec![reply(4, 0.1), reply(5, 0.1)]).is_err());
        let mut toolless = reply(4, 0.1);
        toolless.frames[0].tools.clear();
        assert!(validate(vec![toolless]).is_err());
    }

    #[test]
    fn a_movement_of_the_camera_is_a_distance_at_a_moment_of_the_recording() {
        let sends = |mm: f64, at_s: f64| {
            let moved_during = Some(MovedDuring { mm, at_s });
            validate(vec![FollowReply { moved_during, ..reply(4, 0.1) }])
        };
        assert!(sends(7.0, 3.0).is_ok());
        for (mm, at_s) in [(-1.0, 3.0), (f64::NAN, 3.0), (7.0, -0.1), (7.0, f64::INFINITY), (1e300, 3.0)] {
            assert!(sends(mm, at_s).is_err(), "{mm} mm at {at_s} s");
        }
    }

    #[test]
    fn light_and_placement_are_plausible_numbers_for_every_tool() {
        let sends = |mm: f64, tools: usize, luma_ratio: f64| {
            let shift = Some(Displacement { mm, sigma_mm: 1.0 });
            let placement = Some(ConfirmedPlacement { camera: shift, ports: vec![shift; tools] });
            let light = Some(LightSample { time_s: 0.1, luma_ratio, chroma_shift: [0.0; 2] });
            validate(vec![FollowReply { light, placement, ..reply(4, 0.1) }])
        };
        assert!(sends(7.0, 1, 0.9).is_ok());
        assert!(sends(f64::NAN, 1, 0.9).is_err());
        assert!(sends(7.0, 2, 0.9).is_err());
        assert!(sends(7.0, 1, f64::INFINITY).is_err());
    }

    #[test]
    fn only_for_bare_tools_the_box_is_learned() {
        let sends = |marker: Marker| {
            let mut track = settings();
            track.tools[0].marker = marker;
            validate_for(track, vec![FollowReply { is_learning_box: true, ..reply(4, 0.1) }])
        };
        assert!(sends(Marker::Shaft { collar_mm: None, jaw_mm: None }).is_ok());
        assert!(sends(Marker::Band { length_mm: None }).is_err());
    }

    #[test]
    fn how_well_tools_were_seen_is_a_share_and_a_known_cause_for_every_tool() {
        let sends = |coverage: f64, cause: u32, tools: usize| {
            let worst = Some(LiveConcern { cause, figure: 0.4, limit: 0.5, refuses: true, is_bare: false });
            let seen = Some(vec![SeenSoFar { coverage: Some(coverage), worst }; tools]);
            validate(vec![FollowReply { seen, ..reply(4, 0.1) }])
        };
        assert!(sends(0.4, 4, 1).is_ok());
        assert!(sends(1.4, 4, 1).is_err());
        assert!(sends(f64::NAN, 4, 1).is_err());
        assert!(sends(0.4, QualityCause::ALL.len() as u32, 1).is_err());
        assert!(sends(0.4, 4, 2).is_err());
    }
}
