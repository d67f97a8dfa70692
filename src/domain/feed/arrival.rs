//! How fast a live stream arrived, held against its time stamps. The stamps of some cameras run at another pace than
//! time does, and every speed and duration is then wrong by that factor.

use serde::Serialize;
use utoipa::ToSchema;

/// A reader looks at up to this much of a stream before it hands on the first frame, and then hands on the rest at once,
/// s: the usual limit of FFmpeg.
const SETTLED_AFTER_S: f64 = 5.0;

/// A shorter part of a stream says nothing of its pace, s.
const MIN_STAMPED_S: f64 = 10.0;

/// By how much arrival and stamps differ without a wrong pace: buffers of encoder and network, s, and the part of the
/// time below which a difference hardly matters.
const BUFFERED_S: f64 = 1.0;
const HARDLY_MATTERS: f64 = 0.02;

/// Ratios of arrival to stamps of a stream that was sent while it was made. A file can be pushed much faster.
const LIVE_RATIOS: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// How long the frames of a stream took to arrive, without its first seconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct Arrival {
    /// Time between the arrivals of two frames, by the server's clock, s.
    pub arrived_s: f64,
    /// Time between the same frames by their stamps, s.
    pub stamped_s: f64,
}

impl Arrival {
    /// Do the stamps run at another pace than the stream arrived at?
    pub fn contradicts_stamps(&self) -> bool {
        let Self { arrived_s, stamped_s } = *self;
        LIVE_RATIOS.contains(&(arrived_s / stamped_s))
            && (arrived_s - stamped_s).abs() > BUFFERED_S + HARDLY_MATTERS * stamped_s
    }
}

/// Measures the arrival of a stream frame by frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct ArrivalMeter {
    /// Stamp of the first frame, s.
    first_stamp_s: Option<f64>,
    /// The first frame that arrived after the start had settled: arrival and stamp, s.
    settled: Option<[f64; 2]>,
    /// The last frame.
    last: [f64; 2],
}

impl ArrivalMeter {
    /// Adds a frame in decoding order: the server's time of arrival, and the frame's stamp, s.
    pub fn add(&mut self, arrived_s: f64, stamped_s: f64) {
        let first_stamp_s = *self.first_stamp_s.get_or_insert(stamped_s);
        self.last = [arrived_s, stamped_s];
        if stamped_s >= first_stamp_s + SETTLED_AFTER_S {
            self.settled.get_or_insert(self.last);
        }
    }

    /// The arrival; `None` for a stream that is too short.
    pub fn arrival(&self) -> Option<Arrival> {
        let [from_arrived_s, from_stamped_s] = self.settled?;
        let [arrived_s, stamped_s] = [self.last[0] - from_arrived_s, self.last[1] - from_stamped_s];
        (stamped_s >= MIN_STAMPED_S && arrived_s >= 0.0).then_some(Arrival { arrived_s, stamped_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stream of this many stamped seconds. Each takes `pace` seconds; the first `held_s` arrive at once.
    fn stream(length_s: f64, pace: f64, held_s: f64) -> Option<Arrival> {
        let mut meter = ArrivalMeter::default();
        for frame in 0..(25.0 * length_s) as u32 {
            let stamped_s = f64::from(frame) / 25.0;
            meter.add(100.0 + pace * stamped_s.max(held_s), 7.0 + stamped_s);
        }
        meter.arrival()
    }

    #[test]
    fn a_pace_that_differs_by_a_tenth_is_noticed_and_buffers_are_not() {
        assert!(stream(60.0, 16.4 / 15.0, 0.0).unwrap().contradicts_stamps());
        assert!(stream(60.0, 0.9, 4.0).unwrap().contradicts_stamps());
        for held_s in [0.0, 2.0, 4.9] {
            assert!(!stream(60.0, 1.0, held_s).unwrap().contradicts_stamps(), "{held_s} s held back at the start");
        }
    }

    #[test]
    fn a_file_that_is_pushed_fast_says_nothing_of_its_pace() {
        assert!(!stream(60.0, 0.1, 0.0).unwrap().contradicts_stamps());
        assert_eq!(stream(14.0, 1.2, 0.0), None, "too short");
    }
}
