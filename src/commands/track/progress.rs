//! Progress of tracking.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Progress on stderr: a bar on a terminal, else a line every 5 s; nothing if quiet.
pub(super) struct TrackProgress {
    bar: ProgressBar,
    plain: bool,
    expected: Option<u64>,
    last_line: std::cell::Cell<Instant>,
}

impl TrackProgress {
    pub(super) fn new(expected: Option<u64>, quiet: bool) -> Self {
        const TEMPLATE: &str = "tracking {bar:30} {pos}/{len} frames, {eta} left";
        let terminal = io::stderr().is_terminal() && !quiet;
        let bar = if terminal { ProgressBar::new(expected.unwrap_or(0)) } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template(TEMPLATE) {
            bar.set_style(style);
        }
        Self { bar, plain: !terminal && !quiet, expected, last_line: std::cell::Cell::new(Instant::now()) }
    }

    pub(super) fn step(&self) {
        const LINE_INTERVAL: Duration = Duration::from_secs(5);
        self.bar.inc(1);
        if self.plain && self.last_line.get().elapsed() >= LINE_INTERVAL {
            self.last_line.set(Instant::now());
            let of = self.expected.map(|n| format!(" of {n}")).unwrap_or_default();
            eprintln!("tracking: {}{of} frames", self.bar.position());
        }
    }

    pub(super) fn end(&self) {
        self.bar.finish_and_clear();
    }
}
