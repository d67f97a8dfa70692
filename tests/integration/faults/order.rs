//! No acknowledgement leaves before its bytes and names were synced: checked with the system calls of the real service.
//!
//! `strace` records the writes, syncs, new names and answers of the service; [`Disk`] tracks which of them are durable.
//! A successful answer is a finding while anything is not durable. This shows a missing sync on every machine; `power`
//! shows that the file system keeps what was synced.

use std::collections::HashMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use reqwest::{Method, StatusCode};

use super::{Centre, padded, padded_bytes};
use crate::support::soon;

/// The calls that write, sync, create names and answer.
const CALLS: &str = "openat,write,writev,pwrite64,pwritev,sendto,sendmsg,ftruncate,fsync,fdatasync,link,linkat,rename,\
                     renameat,renameat2,unlink,unlinkat";

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_acknowledgement_leaves_before_its_bytes_and_names_were_synced() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let centre = Centre::open_bare(folder, data.clone(), |_| ()).await;
    let Some(trace) = Trace::begin(&centre, &data) else {
        crate::resources::skip("strace, or the right to trace the service; `make test` installs it");
        return;
    };
    let clip = std::fs::read(centre.scene("clip.mp4")).unwrap();
    let recording = padded(&centre.scene("clip.mp4"), 9 << 20);
    let upload = centre.begin_upload(recording.len()).await;
    for (from, to) in [(0, 1_000), (1_000, 700_000), (700_000, 9_000_000)] {
        let answer = centre.patch(&upload, from, &recording[from..to]).await;
        assert_eq!(answer.status(), StatusCode::NO_CONTENT);
    }
    centre.send_rest(&upload, &recording, 9_000_000).await;
    centre.send_whole(padded_bytes(&clip, clip.len() + 16)).await;
    centre.create("/trainees", "Ben").await;
    let another = centre.begin_upload(1_000).await;
    let path = format!("/uploads/{another}");
    centre.request(Method::DELETE, &path).header("tus-resumable", "1.0.0").send().await.unwrap();
    let seen = trace.end(centre).await;
    eprintln!("{} acknowledgements, {} syncs of files, {} of folders", seen.acknowledged, seen.synced, seen.folders);
    assert!(seen.findings.is_empty(), "\n{}\n", seen.findings.join("\n"));
    assert!(seen.acknowledged >= 9, "every answer was seen");
    assert!(seen.synced > seen.acknowledged && seen.folders >= 4, "the syncs were seen");
}

#[test]
fn the_trace_shows_a_missing_sync() {
    let complete = [
        r#"7 openat(AT_FDCWD</>, "/data/uploads/a", O_WRONLY|O_CREAT|O_EXCL, 0600 <unfinished ...>"#,
        r#"7 <... openat resumed>)             = 9</data/uploads/a>"#,
        r#"7 write(9</data/uploads/a>, "xyz"..., 3) = 3"#,
        r#"8 fdatasync(9</data/uploads/a> <unfinished ...>"#,
        r#"8 <... fdatasync resumed>)          = 0"#,
        r#"7 fsync(4</data/uploads>)         = 0"#,
        r#"7 linkat(AT_FDCWD, "/data/uploads/a", AT_FDCWD, "/data/blobs/b", 0) = 0"#,
        r#"7 fsync(4</data/blobs>) = 0"#,
        r#"6 sendto(5<socket:[1]>, "HTTP/1.1 204 No Content\r\nx"..., 90, 0, NULL, 0) = 90"#,
    ];
    let judge = |lines: &[&str]| {
        let mut disk = Disk::of(Path::new("/data"));
        lines.iter().for_each(|line| disk.read(line));
        (disk.acknowledged, disk.findings.is_empty())
    };
    assert_eq!(judge(&complete), (1, true));
    for missing in [3..5, 5..6, 7..8] {
        let lines: Vec<&str> =
            complete.iter().enumerate().filter(|(i, _)| !missing.contains(i)).map(|(_, l)| *l).collect();
        assert_eq!(judge(&lines), (1, false), "without {missing:?}");
    }
    let mut late = complete;
    late.swap(2, 3); // written during the sync, which may not include it
    assert_eq!(judge(&late), (1, false));
}

/// `strace`, attached to the service.
struct Trace {
    strace: Child,
    log: PathBuf,
    disk: Disk,
}

impl Trace {
    fn begin(centre: &Centre, data: &Path) -> Option<Self> {
        let log = centre.scene("system-calls");
        let mut strace = Command::new("strace")
            .args(["-f", "-y", "-s", "24", "-e", "signal=none", "-e", &format!("trace={CALLS}"), "-o"])
            .arg(&log)
            .args(["-p", &centre.process().id().to_string()])
            .stderr(Stdio::piped())
            .spawn()
            .ok()?;
        let mut lines = BufReader::new(strace.stderr.take()?).lines().map_while(Result::ok);
        lines.find(|line| line.contains("attached"))?;
        std::thread::spawn(move || lines.for_each(drop)); // strace must be able to continue to print
        Some(Self { strace, log, disk: Disk::of(data) })
    }

    /// Kills the service, which ends the trace, and reads the log.
    async fn end(mut self, mut centre: Centre) -> Disk {
        centre.kill();
        let strace = tokio::task::spawn_blocking(move || self.strace.wait());
        soon("the trace's end", strace).await.unwrap().unwrap();
        let log = std::fs::read(&self.log).unwrap();
        String::from_utf8_lossy(&log).lines().for_each(|line| self.disk.read(line));
        self.disk
    }
}

/// Writes and new names in a folder that are not yet durable, with the number of the log line that made them.
#[derive(Default)]
struct Disk {
    data: PathBuf,
    line: usize,
    /// Files with bytes that were not synced.
    written: HashMap<PathBuf, usize>,
    /// Names whose folder was not synced.
    named: HashMap<PathBuf, usize>,
    /// Calls that have begun: per thread, the text so far and the line.
    begun: HashMap<String, (String, usize)>,
    acknowledged: usize,
    synced: usize,
    folders: usize,
    findings: Vec<String>,
}

impl Disk {
    fn of(data: &Path) -> Self {
        Self { data: data.to_owned(), ..Self::default() }
    }

    /// One line of `strace -f -y`: a whole call, its beginning or its end.
    fn read(&mut self, line: &str) {
        self.line += 1;
        let Some((thread, text)) = line.split_once(' ') else { return };
        let text = text.trim_start();
        if let Some(beginning) = text.strip_suffix("<unfinished ...>") {
            self.call_begins(beginning);
            self.begun.insert(thread.to_owned(), (beginning.to_owned(), self.line));
        } else if let Some((_, end)) = text.split_once(" resumed>") {
            let Some((beginning, since)) = self.begun.remove(thread) else { return };
            self.call_ends(&(beginning + end), since);
        } else {
            self.call_begins(text);
            self.call_ends(text, self.line);
        }
    }

    /// Handles events that count from the beginning of a call: writes, which may be visible at once, and answers, which
    /// may arrive at once.
    fn call_begins(&mut self, call: &str) {
        let is_write =
            ["write(", "writev(", "pwrite64(", "pwritev(", "ftruncate("].iter().any(|name| call.starts_with(name));
        match subject(call) {
            Some(path) if is_write && self.must_be_durable(&path) => drop(self.written.insert(path, self.line)),
            Some(path) if path.to_string_lossy().starts_with("socket:") => self.check_answer(call),
            _ => {}
        }
    }

    /// Handles events that count once a call has succeeded: syncs of earlier writes, and new names.
    fn call_ends(&mut self, call: &str, since: usize) {
        if call.rsplit(" = ").next().is_some_and(|answer| answer.starts_with("-1 ")) {
            return;
        }
        let name = call.split('(').next().unwrap_or_default();
        match name {
            "fsync" | "fdatasync" => subject(call).into_iter().for_each(|path| self.add_sync(&path, since)),
            "openat" if call.contains("O_CREAT") => result(call).into_iter().for_each(|path| self.add_name(path)),
            "linkat" | "link" | "rename" | "renameat" | "renameat2" => {
                if let [from, to] = &quoted(call)[..] {
                    if self.written.contains_key(from) {
                        self.written.insert(to.clone(), self.line);
                    }
                    if name.starts_with("rename") {
                        self.forget(from);
                    }
                    self.add_name(to.clone());
                }
            }
            "unlink" | "unlinkat" => quoted(call).iter().for_each(|path| self.forget(path)),
            _ => {}
        }
    }

    fn add_sync(&mut self, path: &Path, since: usize) {
        let folders = self.named.len();
        self.named.retain(|name, line| name.parent() != Some(path) || *line > since);
        self.folders += usize::from(self.named.len() < folders);
        if self.written.get(path).is_some_and(|line| *line <= since) {
            self.written.remove(path);
            self.synced += 1;
        }
    }

    fn add_name(&mut self, path: PathBuf) {
        // The database exists already, so opening it creates no name. A half-written file needs no durable name.
        let is_new = !path.ends_with("trocar.db-wal") && !path.ends_with("trocar.db");
        if self.must_be_durable(&path) && is_new && !path.starts_with(self.data.join("incoming")) {
            self.named.insert(path, self.line);
        }
    }

    fn forget(&mut self, path: &Path) {
        self.written.remove(path);
        self.named.remove(path);
    }

    /// True for files that must be durable before an answer. The log of the database makes a commit durable: its main
    /// file may follow later, and its shared memory is rebuilt.
    fn must_be_durable(&self, path: &Path) -> bool {
        path.starts_with(&self.data) && !path.ends_with("trocar.db") && !path.ends_with("trocar.db-shm")
    }

    fn check_answer(&mut self, call: &str) {
        if !call.contains("\"HTTP/1.1 2") {
            return;
        }
        self.acknowledged += 1;
        for (path, line) in self.written.iter().chain(&self.named) {
            let path = path.display();
            self.findings.push(format!("line {}: {call} while {path} of line {line} is not synced", self.line));
        }
    }
}

/// The file behind a call's first descriptor: `write(9</data/a>, …`.
fn subject(call: &str) -> Option<PathBuf> {
    let (_, arguments) = call.split_once('(')?;
    let descriptor = arguments.split(',').next()?;
    Some(descriptor.split_once('<')?.1.rsplit_once('>')?.0.into())
}

/// The file behind the descriptor that a call answers with: `… = 9</data/a>`.
fn result(call: &str) -> Option<PathBuf> {
    let (_, answer) = call.rsplit_once(" = ")?;
    Some(answer.split_once('<')?.1.strip_suffix('>')?.into())
}

/// The paths in quotes.
fn quoted(call: &str) -> Vec<PathBuf> {
    call.split('"').skip(1).step_by(2).map(PathBuf::from).collect()
}
