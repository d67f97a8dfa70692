//! What the time stamps of a recording say, from its packets alone.

use super::{VideoFile, is_before};
use crate::domain::clock::StampFacts;
use crate::media::annexb::is_hidden;

impl VideoFile {
    /// Frame rate and duration by the stamps of all frames, without decoding. In a damaged recording they can differ
    /// slightly from those of the decoded frames.
    pub fn stamps(mut self) -> StampFacts {
        let mut stamps = Vec::new();
        while (stamps.len() as u64) < self.limits.frames
            && let Some(packet) = self.next_packet()
        {
            let is_shown = !is_hidden(&packet) && !is_before(packet.pts(), self.first_shown);
            if packet.stream() == self.stream && is_shown {
                stamps.push(packet.pts().or(packet.dts()));
            }
        }
        // Packets come in decoding order. Where each has a stamp, the stamps give the order of the frames.
        if stamps.iter().all(Option::is_some) {
            stamps.sort();
        }
        let times_s: Vec<f64> = stamps.into_iter().map(|stamp| self.clock.time_s(stamp)).collect();
        StampFacts::of_times(&times_s)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::media::testing::{all, open, recording};
    use crate::media::{MediaLimits, SampleFormat};

    #[test]
    fn the_stamps_are_those_of_the_decoded_frames() {
        let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 60).into();
        let times: Vec<f64> = all(&clip).into_iter().map(|(_, time_s, _)| time_s).collect();
        let facts = open(&clip, MediaLimits::default()).stamps();
        assert_eq!(facts, StampFacts::of_times(&times));
        assert!((facts.rate_hz.unwrap() - 25.0).abs() < 0.01 && (facts.duration_s - 59.0 / 25.0).abs() < 1e-6);
    }

    #[test]
    fn a_factor_scales_every_time_and_nothing_else() {
        let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 20).into();
        let mut video = open(&clip, MediaLimits::default());
        video.scale_times(0.125);
        let scaled = std::iter::from_fn(|| video.next_picture().unwrap());
        for (picture, (index, time_s, _)) in scaled.zip(all(&clip)) {
            assert_eq!((picture.frame().index, picture.frame().time_s), (index, time_s * 0.125));
        }
    }
}
