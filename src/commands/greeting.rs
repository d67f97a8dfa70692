//! What `trocar serve` prints to stdout: its address and how to sign in. The log goes to stderr.

use std::io::{IsTerminal, Write, stdout};
use std::path::Path;

use rustix::fs::FileType;

use crate::domain::secret::Password;
use crate::upkeep;

/// Prints how to sign in.
#[derive(Clone, Copy, Debug)]
pub struct Greeting {
    shows_passwords: bool,
}

impl Greeting {
    /// A first password is shown to a person on a terminal, and to a program that reads it from a pipe. A file or a
    /// socket, such as that of the journal, keeps what it gets; there, and with `hide_password`, only the name of the
    /// password's file is printed.
    pub fn new(hide_password: bool) -> Self {
        let is_pipe = || {
            let kind = rustix::fs::fstat(stdout()).map(|status| FileType::from_raw_mode(status.st_mode));
            kind.is_ok_and(|kind| kind == FileType::Fifo)
        };
        Self { shows_passwords: !hide_password && (stdout().is_terminal() || is_pipe()) }
    }

    /// Prints how to sign in to an account whose first password is still in its file. `new` is that password if this
    /// start has made the account.
    pub fn print_sign_in(self, data: &Path, login: &str, new: Option<&Password>) {
        let file = upkeep::password_file(data, login);
        if new.is_none() && !file.exists() {
            return;
        }
        let file = std::path::absolute(&file).unwrap_or(file);
        let file = file.display();
        match new.filter(|_| self.shows_passwords) {
            Some(password) => {
                print_line(&format!("Sign in as {login} with the password {}", password.reveal()));
                print_line(&format!("Until it is changed, it is also in {file}"));
            }
            None => {
                print_line(&format!("Sign in as {login} with the password in {file}"));
                print_line("The file is deleted once the password has been changed.");
            }
        }
    }
}

/// Prints a line to stdout only, because the log has other readers. If stdout is closed (`trocar serve | head -1`),
/// `println!` would panic; this function only warns.
pub fn print_line(line: &str) {
    let mut out = stdout().lock();
    if let Err(error) = writeln!(out, "{line}").and_then(|()| out.flush()) {
        tracing::warn!(%error, "cannot write to standard output; a message was lost");
    }
}
