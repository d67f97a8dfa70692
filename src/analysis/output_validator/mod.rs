//! Validates a child's output record by record: the file that the child decoded may have taken over its decoder.
//!
//! A record is accepted if an honest child could have sent it at this point. Sizes, order, indices and numbers are
//! checked by its kind of work ([`super::child::ChildTask::accept`]), so accepted records can be stored and shown.

mod problem_texts;

#[cfg(test)]
use super::child::WorkRecord;
use super::child::{ChildEvent, ChildOutput, ChildWork};
use super::protocol::{self, ChildReply};
use crate::media::MediaLimits;

/// Checks a child's replies as they arrive and keeps their content.
pub(super) struct OutputValidator<'a> {
    work: &'a ChildWork,
    limits: MediaLimits,
    output: ChildOutput,
}

impl<'a> OutputValidator<'a> {
    /// A validator for the replies that this work may give.
    pub(super) fn new(work: &'a ChildWork, limits: MediaLimits) -> Self {
        Self { work, limits, output: ChildOutput::default() }
    }

    /// Validates one record; an error ends the child.
    pub(super) fn validate(&mut self, record: &[u8]) -> Result<ChildEvent, String> {
        let reply = protocol::decode(record).map_err(|e| format!("an unreadable record: {e}"))?;
        if self.output.done || self.output.problem.is_some() {
            return Err("a record after the last one".into());
        }
        if self.output.landlock.is_none() && !matches!(reply, ChildReply::Confined { .. }) {
            return Err("a reply before confinement".into());
        }
        self.accept_reply(reply)
    }

    /// The output after the last record.
    pub(super) fn into_output(self) -> ChildOutput {
        self.output
    }

    fn accept_reply(&mut self, reply: ChildReply) -> Result<ChildEvent, String> {
        match reply {
            ChildReply::Confined { landlock } => {
                if self.output.landlock.replace(landlock).is_some() {
                    return Err("a second confinement".into());
                }
            }
            ChildReply::Alive { done, of } => return Ok(ChildEvent::progress(done, of)),
            ChildReply::Record(record) => return self.work.accept(record, &mut self.output, self.limits),
            ChildReply::Problem(problem) => self.output.problem = Some(problem_texts::presentable(problem)?),
            ChildReply::Done => self.output.done = true,
        }
        Ok(ChildEvent::Nothing)
    }
}

/// Validates these records of a confined child.
#[cfg(test)]
pub(super) fn validate_records(work: &ChildWork, records: Vec<WorkRecord>) -> Result<ChildOutput, String> {
    let mut validator = OutputValidator::new(work, MediaLimits::default());
    let replies = records.into_iter().map(ChildReply::Record);
    for reply in [ChildReply::Confined { landlock: true }].into_iter().chain(replies) {
        validator.validate(&protocol::encode(&reply).map_err(|error| error.to_string())?)?;
    }
    Ok(validator.into_output())
}

#[cfg(test)]
mod tests;
