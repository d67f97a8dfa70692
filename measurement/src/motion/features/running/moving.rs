//! Counts movements and rests of a live path: the rule of [`super::super::movement`], one instant at a time.

use super::super::FeatureSettings;
use super::super::movement::{is_fast, is_long_enough};
use super::super::pauses::PauseTier;

/// Movements and rests so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct MovementCounter {
    /// Number of movements.
    pub movements: u32,
    /// Number of rests below 1 s, of 1 to 3 s, and of 3 s and more.
    pub rests: [u32; 3],
    /// Grid steps in rests of 1 s and more.
    pub idle_steps: i64,
    span: Option<GrowingSpan>,
}

/// The current span.
#[derive(Clone, Copy, Debug)]
struct GrowingSpan {
    /// Instant at which it began or its last movement ended.
    rests_from: i64,
    /// Instant at which the speed rose above rest, and whether it has reached the movement speed since.
    run: Option<(i64, bool)>,
    last: i64,
}

impl MovementCounter {
    /// Adds the speed at the next instant of the span, or at the first instant of a new span.
    pub fn add_instant(&mut self, instant: i64, speed_mm_s: f64, settings: &FeatureSettings) {
        let mut span = self.span.unwrap_or(GrowingSpan { rests_from: instant, run: None, last: instant });
        if is_fast(speed_mm_s, settings) {
            let (first, was_fast_enough) = span.run.unwrap_or((instant, false));
            span.run = Some((first, was_fast_enough || speed_mm_s >= settings.movement_speed_mm_s));
        } else {
            self.end_run(&mut span, settings);
        }
        self.span = Some(GrowingSpan { last: instant, ..span });
    }

    /// Ends the span.
    pub fn end_span(&mut self, settings: &FeatureSettings) {
        if let Some(mut span) = self.span.take() {
            self.end_run(&mut span, settings);
            self.count_rest(span.last - span.rests_from, settings);
        }
    }

    fn end_run(&mut self, span: &mut GrowingSpan, settings: &FeatureSettings) {
        if let Some((first, true)) = span.run.take()
            && is_long_enough(span.last - first, settings)
        {
            self.movements += 1;
            self.count_rest(first - span.rests_from, settings);
            span.rests_from = span.last;
        }
    }

    fn count_rest(&mut self, steps: i64, settings: &FeatureSettings) {
        if steps > 0 {
            let tier = PauseTier::of(steps, settings);
            self.rests[tier as usize] += 1;
            self.idle_steps += if tier == PauseTier::Short { 0 } else { steps };
        }
    }
}
