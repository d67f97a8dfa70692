//! The real program as a process of its own, which can be killed, and whose workers can start children.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::iter::successors;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Changes how a service is started: its user, its limits, its settings.
pub type Launch = fn(&mut Command);

/// A running `trocar serve`. Dropping it kills it.
pub struct Process {
    child: Child,
    /// Where it listens: host and port.
    pub address: String,
    /// The first administrator's password, if this was the first start on the data folder.
    pub password: Option<String>,
    /// Kept open: a service whose stdout is gone could not print.
    _stdout: Box<dyn Iterator<Item = String> + Send>,
}

impl Process {
    /// Starts a service on a data folder and waits until it says where it listens.
    pub fn start(data: &Path) -> Self {
        Self::launch(data, |_| ())
    }

    /// The same, started differently.
    pub fn launch(data: &Path, change: Launch) -> Self {
        let is_first = !data.join("trocar.db").exists();
        let mut command = command(data);
        change(&mut command);
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
        let mut after =
            |mark: &str| lines.find_map(|line| Some(line.split_once(mark)?.1.trim_end_matches('/').to_owned()));
        let address = after("http://").expect("the service says where it listens");
        let password = is_first.then(|| after("password ").expect("the first start tells the password"));
        Self { child, address, password, _stdout: Box::new(lines) }
    }

    /// The process's id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// A field of what the system says of the process, as `VmRSS`, without its unit.
    pub fn status(&self, field: &str) -> String {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix(field)?.strip_prefix(':'));
        line.unwrap().trim().trim_end_matches(" kB").to_owned()
    }

    /// Seconds of the processors that it has taken, and all children that run.
    pub fn processors_s(&self) -> f64 {
        let names = std::fs::read_dir("/proc").unwrap().filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let all: BTreeMap<u32, Processors> =
            names.filter_map(|name| Some((name.parse().ok()?, Processors::of(&name)?))).collect();
        let is_ours = |id: &u32| {
            let up = successors(Some(*id), |id| Some(all.get(id)?.parent));
            up.take_while(|id| *id != 0).any(|id| id == self.id())
        };
        all.iter().filter(|(id, _)| is_ours(id)).map(|(_, taken)| taken.own_s).sum()
    }
}

/// What a process has taken of the processors.
pub struct Processors {
    parent: u32,
    own_s: f64,
    /// Of children that have ended and were waited for.
    pub of_ended_s: f64,
}

impl Processors {
    /// By a process's id, or `self`. `None` if there is no such process.
    pub fn of(process: &str) -> Option<Self> {
        /// Ticks in a second, in which the kernel tells it on every machine.
        const TICKS: f64 = 100.0;
        let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
        // Fields by their numbers in proc(5); the second is a name with any characters.
        let fields: Vec<&str> = stat.rsplit_once(") ")?.1.split(' ').collect();
        let field = |number: usize| fields.get(number - 3)?.parse::<f64>().ok();
        let sum_s = |user, system| Some((field(user)? + field(system)?) / TICKS);
        Some(Self { parent: field(4)? as u32, own_s: sum_s(14, 15)?, of_ended_s: sum_s(16, 17)? })
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill(); // SIGKILL; it may have ended already
        let _ = self.child.wait();
    }
}

/// `trocar serve` on a data folder.
pub fn command(data: &Path) -> Command {
    let mut command = program();
    command.args(["serve", "--listen", "127.0.0.1:0", "--workers", "1", "--log", "error", "--data"]).arg(data);
    command
}

/// The program. What the environment says to the tests (`TROCAR_KILLS`) is no setting of it, and would be refused.
pub fn program() -> Command {
    // What is measured is measured on a release build, which `make` names.
    let own = || env!("CARGO_BIN_EXE_trocar").into();
    let mut command = Command::new(std::env::var_os("TROCAR_PROGRAM").unwrap_or_else(own));
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("TROCAR_")) {
        command.env_remove(name);
    }
    command
}
