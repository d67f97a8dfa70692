//! Splits a live stream into coded frames while it is pushed; its pipe can be read only once.

use std::fs::File;

use super::reporter::Reporter;
use super::{Halt, explain};
use crate::analysis::protocol::Answer;
use crate::domain::feed::MOST_PAYLOAD;
use crate::media::{Limits, Source};

pub(super) fn run(inputs: Vec<File>, limits: Limits, reporter: &mut Reporter) -> Result<(), Halt> {
    let pipe = inputs.into_iter().next().ok_or_else(|| Halt::Explained(explain::no_input()))?;
    let mut source = Source::pushed(pipe, limits)?;
    reporter.say(&Answer::Stream(source.info().clone()))?;
    while let Some(mut frame) = source.next_frame()? {
        if frame.bytes.len() > MOST_PAYLOAD {
            frame.bytes.clear();
        }
        reporter.say(&Answer::Coded(frame))?;
    }
    Ok(())
}
