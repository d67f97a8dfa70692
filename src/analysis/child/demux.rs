//! Splits a live stream into coded frames while it is pushed; its pipe can be read only once.

use serde::{Deserialize, Serialize};

use super::limits::{MAX_TEXT_CHARS, set_size};
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::domain::feed::MAX_PAYLOAD;
use crate::media::{CaptureSource, CapturedFrame, MediaLimits, SourceInfo};

/// Needs nothing besides the stream.
#[derive(Debug, Serialize, Deserialize)]
pub struct DemuxWork;

/// A record about a pushed stream.
#[derive(Debug, Serialize, Deserialize)]
pub enum DemuxRecord {
    /// What it contains.
    Stream(SourceInfo),
    /// Its next frame, in the order of decoding; without bytes where it is damaged or too long.
    Coded(CapturedFrame),
}

/// Width and height of the stream, pixels, once they are known. All else is passed on at once.
#[derive(Debug, Default)]
pub struct DemuxOutput(Option<(u32, u32)>);

impl ChildTask for DemuxWork {
    type Record = DemuxRecord;
    type Output = DemuxOutput;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let limits = inputs.limits;
        let mut source = CaptureSource::pushed(inputs.first()?, limits)?;
        reporter.record(WorkRecord::Demux(DemuxRecord::Stream(source.info().clone())))?;
        while let Some(mut frame) = source.next_frame()? {
            if frame.bytes.len() > MAX_PAYLOAD {
                frame.bytes.clear();
            }
            reporter.record(WorkRecord::Demux(DemuxRecord::Coded(frame)))?;
        }
        Ok(())
    }

    fn accept(&self, record: DemuxRecord, output: &mut DemuxOutput, limits: MediaLimits) -> Result<ChildEvent, String> {
        match record {
            DemuxRecord::Stream(info) => {
                set_size(&mut output.0, info.size, limits)?;
                match info.coded_from.as_ref().is_none_or(|codec| codec.len() <= MAX_TEXT_CHARS[0] && codec.is_ascii())
                {
                    true => Ok(ChildEvent::Stream(info)),
                    false => Err("a codec without a name".into()),
                }
            }
            DemuxRecord::Coded(frame) => {
                match output.0.is_some() && frame.bytes.len() <= MAX_PAYLOAD && frame.due_s.is_finite() {
                    true => Ok(ChildEvent::Coded(frame)),
                    false => Err("an invalid frame of a stream".into()),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::child::recording::RecordingRecord;
    use crate::analysis::output_validator::validate_records;
    use crate::domain::feed::FrameCodec;

    #[test]
    fn frames_of_a_stream_follow_its_header_and_none_exceeds_the_feeds_limit() {
        let hear = |records: Vec<DemuxRecord>| {
            let records = records.into_iter().map(WorkRecord::Demux).collect();
            validate_records(&ChildWork::Demux(DemuxWork), records)
        };
        let stream = |size| {
            let time_base = [1, 90_000].try_into().unwrap();
            DemuxRecord::Stream(SourceInfo {
                codec: FrameCodec::H264,
                size,
                time_base,
                coded_from: None,
                has_end: true,
                is_file: false,
                is_camera: false,
            })
        };
        let frame =
            |bytes, due_s| DemuxRecord::Coded(CapturedFrame { time: 0, due_s, is_key: true, bytes: vec![1; bytes] });
        assert!(hear(vec![stream((640, 480)), frame(9, 0.0), frame(MAX_PAYLOAD, 0.04), frame(0, 0.08)]).is_ok());
        assert!(hear(vec![frame(9, 0.0)]).is_err());
        assert!(hear(vec![stream((640, 480)), stream((640, 480))]).is_err());
        assert!(hear(vec![stream((60_000, 480))]).is_err());
        assert!(hear(vec![stream((640, 480)), frame(MAX_PAYLOAD + 1, 0.0)]).is_err());
        assert!(hear(vec![stream((640, 480)), frame(9, f64::NAN)]).is_err());
        let preview = WorkRecord::Probe(RecordingRecord::Preview(vec![0xff, 0xd8]));
        assert!(validate_records(&ChildWork::Demux(DemuxWork), vec![preview]).is_err());
    }
}
