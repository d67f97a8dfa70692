//! `trocar agent install`: the agent as a service of systemd that stands by, under a user of its own.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};

use super::key_value;
use super::screen::ScreenLanguage;
use super::standby::installed_spool;
use crate::capture::connection::{DisconnectOutcome, Server};
use crate::commands::CommandFailure;
use crate::commands::greeting::print_line;
use crate::media::CaptureSource;

/// Name of the unit. A unit of this name in `/etc` replaces the one of the Debian package.
const UNIT: &str = "trocar-agent.service";
/// Where systemd looks for units of the administrator, and the token's place.
const UNITS: &str = "/etc/systemd/system";
const TOKEN: &str = "/etc/trocar/agent.token";
/// How long the camera may take to open.
const OPEN_TIMEOUT: Duration = Duration::from_secs(15);
/// Cameras that a message names.
const MAX_CAMERAS: usize = 8;
/// Longest value of an argument in a unit, bytes.
const MAX_ARGUMENT_BYTES: usize = 1000;

/// Arguments of `trocar agent install`.
#[derive(clap::Args)]
pub(super) struct InstallArgs {
    /// Address of the server, such as `https://trocar.example`
    #[arg(long, value_name = "URL")]
    server: String,
    /// Id or code of the box that the camera belongs to
    #[arg(long = "box", value_name = "CODE")]
    in_box: String,
    /// File with the token of the box's agent; it is copied to /etc/trocar/agent.token
    #[arg(long, value_name = "FILE")]
    token_file: PathBuf,
    /// Serve the page for the box's own screen at this port of this computer
    #[arg(long, value_name = "PORT")]
    screen: Option<u16>,
    /// Key on that page that starts and stops, such as Space, Enter, F9 or KeyB
    #[arg(long, value_name = "KEY", requires = "screen")]
    key: Option<String>,
    /// Language of that page; by default that of its browser
    #[arg(long, value_enum, requires = "screen")]
    language: Option<ScreenLanguage>,
    /// FFmpeg option for the camera, such as video_size=1280x720; may be repeated
    #[arg(long = "option", value_name = "KEY=VALUE", value_parser = key_value)]
    options: Vec<(String, String)>,
    /// Make no recordings without a name: the button and the key do nothing until a trainee has checked in
    #[arg(long)]
    require_check_in: bool,
    /// Let the recording of a trainee who checks in begin by itself, with the first movement in the picture; the key starts
    /// the next one the same way
    #[arg(long)]
    start_on_movement: bool,
    /// Print the unit, and change nothing
    #[arg(long)]
    print: bool,
    /// Install although the camera or the server may not be there yet
    #[arg(long)]
    without_checks: bool,
    /// Camera, such as /dev/video0; /dev/v4l/by-id/… names one camera, also when others are plugged in
    source: String,
}

/// Arguments of `trocar agent uninstall`.
#[derive(clap::Args)]
pub(super) struct UninstallArgs {
    /// Delete the token as well
    #[arg(long)]
    token: bool,
}

/// Runs `trocar agent install`.
pub(super) fn run(args: InstallArgs) -> Result<(), CommandFailure> {
    Server::new(&args.server, &args.in_box, Path::new(TOKEN)).map_err(|why| CommandFailure::Input(anyhow!(why)))?;
    let program = std::env::current_exe().context("finding this program")?;
    let unit = unit(&args, &program).map_err(|why| CommandFailure::Input(anyhow!(why)))?;
    if args.print {
        print_line(unit.trim_end());
        return Ok(());
    }
    let token = fs::read_to_string(&args.token_file)
        .with_context(|| format!("reading the token {}", args.token_file.display()))
        .map_err(CommandFailure::Input)?;
    if !token.trim().starts_with("trc_") {
        let shown = args.token_file.display();
        let why = anyhow!(
            "{shown} holds no token; a token begins with trc_. Make one on the page of the box, or with \
             `trocar admin token add NAME --box BOX` on the server"
        );
        return Err(CommandFailure::Input(why));
    }
    check_system().map_err(|why| CommandFailure::Input(anyhow!(why)))?;
    if !args.without_checks {
        check_camera(&args).and_then(|()| check_server(&args)).map_err(|why| {
            let hint = "nothing was installed. To install all the same, add --without-checks";
            CommandFailure::Input(anyhow!("{why}; {hint}"))
        })?;
    }
    replace_file(Path::new(TOKEN), token.trim().as_bytes(), 0o600).with_context(as_root(TOKEN))?;
    let path = Path::new(UNITS).join(UNIT);
    replace_file(&path, unit.as_bytes(), 0o644).with_context(as_root(UNITS))?;
    systemctl(["daemon-reload"])?;
    systemctl(["enable", UNIT])?;
    systemctl(["restart", UNIT])?;
    print_line(&format!("The agent stands by: {} · see it with: journalctl -u trocar-agent -f", path.display()));
    if let Some(port) = args.screen {
        print_line(&format!("The page of the box's screen: http://127.0.0.1:{port}/"));
    }
    Ok(())
}

/// Fails if no service can be installed on this system, or not by this user.
fn check_system() -> Result<(), &'static str> {
    // The test of sd_booted(3): systemd may be installed without running.
    if !Path::new("/run/systemd/system").is_dir() {
        return Err("systemd does not run on this computer, so no service was installed: let another program start \
                    `trocar agent stand-by` with the same arguments, and start it again when it ends");
    }
    if !rustix::process::geteuid().is_root() {
        return Err("only root can install a service: run the command with sudo");
    }
    Ok(())
}

/// Fails if the camera cannot be opened. A service that runs already has it, so it is not opened then.
fn check_camera(args: &InstallArgs) -> Result<(), String> {
    let source = &args.source;
    if !source.contains("://") && !Path::new(source).exists() {
        return Err(format!("{source} does not exist: {}", other_cameras(&cameras())));
    }
    let is_active = Command::new("systemctl").args(["is-active", "--quiet", UNIT]).stderr(Stdio::null()).status();
    if is_active.is_ok_and(|status| status.success()) {
        return Ok(());
    }
    let (ended, opened) = mpsc::channel();
    let (address, options, began) = (source.clone(), args.options.clone(), Instant::now());
    std::thread::spawn(move || {
        let camera = CaptureSource::open(&address, &options, move || began.elapsed() > OPEN_TIMEOUT);
        let _ = ended.send(camera.map(drop).map_err(|error| error.to_string())); // the command may have ended
    });
    let opened = opened.recv_timeout(OPEN_TIMEOUT + Duration::from_secs(1));
    match opened.unwrap_or_else(|_| Err(format!("no answer within {OPEN_TIMEOUT:?}"))) {
        Ok(()) => Ok(()),
        Err(why) => Err(format!(
            "the camera {source} cannot be used ({why}): {}; if it is the right one, close the programs that use it and \
             compare the --option arguments with `v4l2-ctl -d {source} --list-formats-ext`",
            other_cameras(&cameras())
        )),
    }
}

/// The cameras of this computer, by their lasting names if they have such.
fn cameras() -> Vec<PathBuf> {
    let files = |folder: &str| -> Vec<PathBuf> {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut found: Vec<PathBuf> = entries.collect();
        found.sort();
        found
    };
    let lasting = files("/dev/v4l/by-id");
    if !lasting.is_empty() {
        return lasting;
    }
    let is_camera = |path: &PathBuf| path.to_string_lossy().starts_with("/dev/video");
    files("/dev").into_iter().filter(is_camera).collect()
}

fn other_cameras(found: &[PathBuf]) -> String {
    if found.is_empty() {
        return "no camera is plugged in; plug it in".to_owned();
    }
    let names: Vec<String> = found.iter().take(MAX_CAMERAS).map(|path| path.display().to_string()).collect();
    format!("plug it in, or name one of {}", names.join(", "))
}

/// Fails if the server cannot be reached, or refuses the token.
fn check_server(args: &InstallArgs) -> Result<(), String> {
    let server = Server::new(&args.server, &args.in_box, &args.token_file)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|error| format!("starting the runtime: {error}"))?;
    match runtime.block_on(server.check()) {
        None => Ok(()),
        Some(DisconnectOutcome::Retry { why, .. }) => Err(format!(
            "the server {} cannot be reached ({why}): compare --server with the address of the pages",
            args.server
        )),
        Some(DisconnectOutcome::Refused(why)) => Err(why),
        Some(DisconnectOutcome::Complete(_) | DisconnectOutcome::Empty) => Ok(()),
    }
}

/// Runs `trocar agent uninstall`.
pub(super) fn uninstall(args: UninstallArgs) -> Result<(), CommandFailure> {
    let path = Path::new(UNITS).join(UNIT);
    if !path.exists() {
        return Err(CommandFailure::Input(anyhow!("{} does not exist: no agent is installed", path.display())));
    }
    systemctl(["disable", "--now", UNIT])?;
    fs::remove_file(&path).with_context(as_root(UNITS))?;
    if args.token {
        fs::remove_file(TOKEN).with_context(as_root(TOKEN))?;
    }
    systemctl(["daemon-reload"])?;
    print_line(&format!("Removed. Recordings that were not sent are still in {}", installed_spool().display()));
    Ok(())
}

fn as_root(path: &str) -> impl Fn() -> String {
    move || format!("writing {path}; run the command with sudo")
}

/// Writes a file in one step. What was there is replaced, also a link: removing the package masks the unit with a link to
/// `/dev/null`, and a write through it would be lost.
fn replace_file(path: &Path, content: &[u8], mode: u32) -> std::io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("/"));
    fs::create_dir_all(folder)?;
    let new = path.with_extension("new");
    let mut file = fs::OpenOptions::new().write(true).create(true).truncate(true).mode(mode).open(&new)?;
    file.set_permissions(fs::Permissions::from_mode(mode))?; // it may be left over with others
    file.write_all(content)?;
    file.sync_all()?;
    fs::rename(new, path)
}

fn systemctl<const N: usize>(arguments: [&str; N]) -> Result<(), CommandFailure> {
    let status = Command::new("systemctl").args(arguments).status();
    let status = status.context("running systemctl; without systemd no service can be installed")?;
    if status.success() {
        return Ok(());
    }
    let hint = match rustix::process::geteuid().is_root() {
        true => "`systemctl status trocar-agent` and `journalctl -u trocar-agent` say more",
        false => "run the command with sudo",
    };
    Err(CommandFailure::Failed(anyhow!("systemctl {} failed; {hint}", arguments.join(" "))))
}

/// The unit as text.
fn unit(args: &InstallArgs, program: &Path) -> Result<String, String> {
    let mut command = vec![quoted(program.as_os_str())?];
    for word in ["agent", "stand-by", "--token-file", "%d/token"] {
        command.push(word.to_owned());
    }
    let mut add = |words: &[&str]| -> Result<(), String> {
        for word in words {
            command.push(quoted(OsStr::new(word))?);
        }
        Ok(())
    };
    add(&["--spool", &installed_spool().to_string_lossy(), "--server", &args.server, "--box", &args.in_box])?;
    if let Some(port) = args.screen {
        add(&["--screen", &port.to_string()])?;
    }
    if let Some(key) = &args.key {
        add(&["--key", key])?;
    }
    if let Some(language) = args.language {
        add(&["--language", language.tag()])?;
    }
    if args.require_check_in {
        add(&["--require-check-in"])?;
    }
    if args.start_on_movement {
        add(&["--start-on-movement"])?;
    }
    for (key, value) in &args.options {
        add(&["--option", &format!("{key}={value}")])?;
    }
    add(&[&args.source])?;
    Ok(TEMPLATE.replace("COMMAND", &command.join(" ")).replace("TOKEN", TOKEN))
}

/// A word of a command line in a unit: systemd expands `%` and `$`, and ends words at spaces.
fn quoted(word: &OsStr) -> Result<String, String> {
    let word = word.to_str().filter(|word| !word.is_empty() && !word.chars().any(char::is_control));
    let word = word.filter(|word| word.len() <= MAX_ARGUMENT_BYTES);
    let word = word.ok_or("an argument is empty, too long, or has characters that a unit cannot hold")?;
    let escaped = word.replace('\\', "\\\\").replace('"', "\\\"").replace('%', "%%").replace('$', "$$");
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-:=,@%$".contains(c);
    Ok(if escaped.chars().all(is_plain) { escaped } else { format!("\"{escaped}\"") })
}

const TEMPLATE: &str = "\
# Written by `trocar agent install`; run it again to change it. docs/agent.md describes it.
[Unit]
Description=Trocar: stands by at a box trainer
# Stops before the network does. It starts without one: a box records, and sends later.
After=network.target

[Service]
LoadCredential=token:TOKEN
ExecStart=COMMAND
# Always there: also after an end without an error.
Restart=always
RestartSec=2s
# A recording that runs ends; what is not sent is sent after the next start.
TimeoutStopSec=15s

DynamicUser=yes
SupplementaryGroups=video
StateDirectory=trocar-agent
StateDirectoryMode=0700
UMask=0077
DevicePolicy=closed
DeviceAllow=char-video4linux rw
NoNewPrivileges=yes
CapabilityBoundingSet=
ProtectSystem=strict
ProtectHome=yes
PrivateTmp=yes
ProtectProc=invisible
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
RestrictNamespaces=yes
RestrictRealtime=yes
RestrictSUIDSGID=yes
LockPersonality=yes
RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallErrorNumber=EPERM
MemoryMax=1G

[Install]
WantedBy=multi-user.target
";

#[cfg(test)]
mod tests {
    use super::*;

    fn args(source: &str) -> InstallArgs {
        InstallArgs {
            server: "https://trocar.example".to_owned(),
            in_box: "box-1".to_owned(),
            token_file: "token".into(),
            screen: Some(8090),
            key: Some("F9".to_owned()),
            language: Some(ScreenLanguage::De),
            options: vec![("video_size".to_owned(), "1280x720".to_owned())],
            require_check_in: true,
            start_on_movement: true,
            print: true,
            without_checks: false,
            source: source.to_owned(),
        }
    }

    #[test]
    fn the_unit_starts_the_agent_with_these_arguments() {
        let unit = unit(&args("/dev/video0"), Path::new("/usr/bin/trocar")).unwrap();
        let command = "ExecStart=/usr/bin/trocar agent stand-by --token-file %d/token --spool /var/lib/trocar-agent \
                       --server https://trocar.example --box box-1 --screen 8090 --key F9 --language de \
                       --require-check-in --start-on-movement --option video_size=1280x720 /dev/video0\n";
        assert!(unit.contains(command), "{unit}");
        assert!(unit.contains("LoadCredential=token:/etc/trocar/agent.token\n") && unit.contains("Restart=always\n"));
    }

    #[test]
    fn the_units_of_the_agent_wait_for_no_network() {
        let of_package = include_str!("../../../systemd/trocar-agent.service");
        for unit in [unit(&args("/dev/video0"), Path::new("/usr/bin/trocar")).unwrap(), of_package.to_owned()] {
            assert!(!unit.contains("network-online"), "a box records without one: {unit}");
            assert!(unit.contains("\nAfter=network.target\n"), "the agent sends until it has stopped: {unit}");
        }
    }

    #[test]
    fn a_masked_unit_is_replaced_and_what_it_links_to_stays() {
        let folder = tempfile::tempdir().unwrap();
        let (path, elsewhere) = (folder.path().join("units").join(UNIT), folder.path().join("elsewhere"));
        fs::write(&elsewhere, "another file").unwrap();
        fs::create_dir(path.parent().unwrap()).unwrap();
        std::os::unix::fs::symlink(&elsewhere, &path).unwrap();
        replace_file(&path, b"[Unit]", 0o644).unwrap();
        assert!(fs::symlink_metadata(&path).unwrap().is_file());
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o644);
        assert_eq!(
            (fs::read_to_string(&path).unwrap(), fs::read_to_string(&elsewhere).unwrap()),
            ("[Unit]".into(), "another file".into())
        );
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "nothing is left over");
    }

    #[test]
    fn systemd_accepts_the_unit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(UNIT);
        fs::write(&path, unit(&args("/dev/video0"), Path::new("/bin/true")).unwrap()).unwrap();
        // The text is compared above; a machine without systemd cannot say more.
        let Ok(verified) = Command::new("systemd-analyze").arg("verify").arg(&path).output() else { return };
        let said = String::from_utf8_lossy(&verified.stderr);
        assert!(!said.contains(UNIT), "{said}");
    }

    #[test]
    fn a_wrong_device_and_a_missing_server_are_named_with_what_to_do() {
        let why = check_camera(&args("/dev/no-such-camera")).unwrap_err();
        assert!(why.starts_with("/dev/no-such-camera does not exist: ") && why.contains("plug it in"), "{why}");
        assert_eq!(other_cameras(&["/dev/video2".into()]), "plug it in, or name one of /dev/video2");
        let why = check_camera(&args("/dev/null")).unwrap_err();
        assert!(why.starts_with("the camera /dev/null cannot be used ("), "{why}");
        let folder = tempfile::tempdir().unwrap();
        let token_file = folder.path().join("token");
        fs::write(&token_file, "trc_x").unwrap();
        let server = "http://127.0.0.1:9".to_owned();
        let why = check_server(&InstallArgs { server, token_file, ..args("/dev/video0") }).unwrap_err();
        assert!(why.starts_with("the server http://127.0.0.1:9 cannot be reached ("), "{why}");
    }

    #[test]
    fn words_are_quoted_for_systemd() {
        let quote = |word: &str| quoted(OsStr::new(word));
        assert_eq!(quote("/dev/video0").unwrap(), "/dev/video0");
        assert_eq!(quote("rtsp://a/b?c=50%&d=$x y\"z").unwrap(), r#""rtsp://a/b?c=50%%&d=$$x y\"z""#);
        for bad in ["", "a\nExecStartPre=/bin/sh", &"x".repeat(2000)] {
            assert!(quote(bad).is_err(), "{bad:?}");
        }
    }
}
