//! The real program as a separate process: it can be killed, and its workers can start children.

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
    /// Host and port that it listens on.
    pub address: String,
    /// The first administrator's password, if this was the first start on the data folder.
    pub password: Option<String>,
    /// Kept open: the service could not print to a closed stdout.
    _stdout: Box<dyn Iterator<Item = String> + Send>,
}

/// The first administrator's password, from its file in the data folder.
pub fn first_password(data: &Path) -> String {
    let text = std::fs::read_to_string(data.join("administrator.password")).expect("the first start writes the file");
    text.lines().find_map(|line| line.strip_prefix("password: ")).unwrap().to_owned()
}

impl Process {
    /// Starts a service on a data folder and waits until it prints its address.
    pub fn start(data: &Path) -> Self {
        Self::launch(data, |_| ())
    }

    /// The same, started differently.
    pub fn launch(data: &Path, change: impl FnOnce(&mut Command)) -> Self {
        let is_first = !data.join("trocar.db").exists();
        let mut command = command(data);
        change(&mut command);
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
        let address = lines.find_map(|line| {
            let (_, address) = line.split_once("http://").or_else(|| line.split_once("https://"))?;
            Some(address.trim_end_matches('/').to_owned())
        });
        let address = address.expect("the service prints its address");
        let password = is_first.then(|| first_password(data));
        Self { child, address, password, _stdout: Box::new(lines) }
    }

    /// The process's id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// A field of `/proc/<id>/status`, for example `VmRSS`, without its unit.
    pub fn status(&self, field: &str) -> String {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix(field)?.strip_prefix(':'));
        line.unwrap().trim().trim_end_matches(" kB").to_owned()
    }

    /// CPU seconds that the process and its running descendants have used.
    pub fn cpu_s(&self) -> f64 {
        let names = std::fs::read_dir("/proc").unwrap().filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let all: BTreeMap<u32, CpuTimes> =
            names.filter_map(|name| Some((name.parse().ok()?, CpuTimes::of(&name)?))).collect();
        let is_ours = |id: &u32| {
            let ancestors = successors(Some(*id), |id| Some(all.get(id)?.parent));
            ancestors.take_while(|id| *id != 0).any(|id| id == self.id())
        };
        all.iter().filter(|(id, _)| is_ours(id)).map(|(_, times)| times.own_s).sum()
    }
}

/// The CPU time of a process, s.
pub struct CpuTimes {
    parent: u32,
    own_s: f64,
    /// CPU time of children that have ended and were waited for.
    pub ended_children_s: f64,
}

impl CpuTimes {
    /// CPU time of the process itself.
    pub fn own_s(&self) -> f64 {
        self.own_s
    }

    /// Reads the CPU time of a process by its id, or by `self`. `None` if there is no such process.
    pub fn of(process: &str) -> Option<Self> {
        /// The kernel's unit for CPU times, the same on every machine.
        const TICKS_PER_S: f64 = 100.0;
        let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
        // Fields by their numbers in proc(5); the second is a name that may contain any character.
        let fields: Vec<&str> = stat.rsplit_once(") ")?.1.split(' ').collect();
        let field = |number: usize| fields.get(number - 3)?.parse::<f64>().ok();
        let sum_s = |user, system| Some((field(user)? + field(system)?) / TICKS_PER_S);
        Some(Self { parent: field(4)? as u32, own_s: sum_s(14, 15)?, ended_children_s: sum_s(16, 17)? })
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

/// The program, without the environment variables of the tests (`TROCAR_KILLS`): it refuses unknown settings.
pub fn program() -> Command {
    // Measurements use a release build; `make` passes its path in this variable.
    let own = || env!("CARGO_BIN_EXE_trocar").into();
    let mut command = Command::new(std::env::var_os("TROCAR_PROGRAM").unwrap_or_else(own));
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("TROCAR_")) {
        command.env_remove(name);
    }
    command
}
