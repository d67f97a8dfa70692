//! Progress of long work, on stderr: a bar on a terminal, else plain lines; nothing if quiet.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

/// Shows the progress of the work.
pub struct Meter {
    style: MeterStyle,
    what: &'static str,
    tenths: usize,
}

enum MeterStyle {
    Bar(ProgressBar),
    Lines,
    Quiet,
}

impl Meter {
    /// A meter in the style that suits stderr.
    pub fn new(quiet: bool) -> Self {
        let style = match (quiet, std::io::stderr().is_terminal()) {
            (true, _) => MeterStyle::Quiet,
            (false, true) => MeterStyle::Bar(bar()),
            (false, false) => MeterStyle::Lines,
        };
        Self { style, what: "", tenths: 0 }
    }

    /// Shows that `done` of `all` are done. A plain line appears once every tenth.
    pub fn show(&mut self, what: &'static str, done: usize, all: usize) {
        if self.what != what {
            (self.what, self.tenths) = (what, 0);
        }
        match &self.style {
            MeterStyle::Quiet => {}
            MeterStyle::Bar(bar) => {
                bar.set_message(what);
                bar.set_length(all as u64);
                bar.set_position(done as u64);
            }
            MeterStyle::Lines => {
                let tenths = done * 10 / all.max(1);
                if tenths > self.tenths {
                    self.tenths = tenths;
                    eprintln!("{what} {done}/{all}");
                }
            }
        }
    }

    /// Ends with a line that states the outcome.
    pub fn finish(self, outcome: &str) {
        match self.style {
            MeterStyle::Quiet => {}
            MeterStyle::Bar(bar) => {
                bar.finish_and_clear();
                eprintln!("{outcome}");
            }
            MeterStyle::Lines => eprintln!("{outcome}"),
        }
    }
}

fn bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:>8} {bar:40} {pos}/{len} {eta}");
    let bar = ProgressBar::new(0);
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar, // cannot happen: the template is valid
    }
}
