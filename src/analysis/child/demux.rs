//! Splits a live stream into coded frames while it is pushed; its pipe can be read only once.

use std::fs::File;

use super::reporter::Reporter;
use super::{StopReason, explain};
use crate::analysis::protocol::ChildReply;
use crate::domain::feed::MAX_PAYLOAD;
use crate::media::{CaptureSource, MediaLimits};

pub(super) fn run(inputs: Vec<File>, limits: MediaLimits, reporter: &mut Reporter) -> Result<(), StopReason> {
    let pipe = inputs.into_iter().next().ok_or_else(|| StopReason::Impossible(explain::no_input()))?;
    let mut source = CaptureSource::pushed(pipe, limits)?;
    reporter.send(&ChildReply::Stream(source.info().clone()))?;
    while let Some(mut frame) = source.next_frame()? {
        if frame.bytes.len() > MAX_PAYLOAD {
            frame.bytes.clear();
        }
        reporter.send(&ChildReply::Coded(frame))?;
    }
    Ok(())
}
