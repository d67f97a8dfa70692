//! Progress of long work: a bar on a terminal, plain lines elsewhere, nothing when asked to be quiet. Always on stderr.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

/// Shows how far the work is.
pub struct Meter {
    form: Form,
    what: &'static str,
    tenths: usize,
}

enum Form {
    Bar(ProgressBar),
    Lines,
    Quiet,
}

impl Meter {
    /// A meter that suits where stderr leads.
    pub fn new(quiet: bool) -> Self {
        let form = match (quiet, std::io::stderr().is_terminal()) {
            (true, _) => Form::Quiet,
            (false, true) => Form::Bar(bar()),
            (false, false) => Form::Lines,
        };
        Self { form, what: "", tenths: 0 }
    }

    /// Says that `done` of `all` are done; a plain line appears once for every tenth.
    pub fn show(&mut self, what: &'static str, done: usize, all: usize) {
        if self.what != what {
            (self.what, self.tenths) = (what, 0);
        }
        match &self.form {
            Form::Quiet => {}
            Form::Bar(bar) => {
                bar.set_message(what);
                bar.set_length(all as u64);
                bar.set_position(done as u64);
            }
            Form::Lines => {
                let tenths = done * 10 / all.max(1);
                if tenths > self.tenths {
                    self.tenths = tenths;
                    eprintln!("{what} {done}/{all}");
                }
            }
        }
    }

    /// Ends with a line that says what came of it.
    pub fn finish(self, outcome: &str) {
        match self.form {
            Form::Quiet => {}
            Form::Bar(bar) => {
                bar.finish_and_clear();
                eprintln!("{outcome}");
            }
            Form::Lines => eprintln!("{outcome}"),
        }
    }
}

fn bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:>8} {bar:40} {pos}/{len} {eta}");
    let bar = ProgressBar::new(0);
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar, // the template above is fixed and valid; the default bar would do as well
    }
}
