//! `trocar agent install`: the agent as a service of systemd that stands by, under a user of its own.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, anyhow};

use super::key_value;
use super::standby::installed_spool;
use crate::capture::connection::Server;
use crate::commands::CommandFailure;
use crate::commands::greeting::print_line;

/// Name of the unit. A unit of this name in `/etc` replaces the one of the Debian package.
const UNIT: &str = "trocar-agent.service";
/// Where systemd looks for units of the administrator, and the token's place.
const UNITS: &str = "/etc/systemd/system";
const TOKEN: &str = "/etc/trocar/agent.token";
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
    /// FFmpeg option for the camera, such as video_size=1280x720; may be repeated
    #[arg(long = "option", value_name = "KEY=VALUE", value_parser = key_value)]
    options: Vec<(String, String)>,
    /// Print the unit, and change nothing
    #[arg(long)]
    print: bool,
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
        let why = anyhow!("{} holds no token; it begins with trc_", args.token_file.display());
        return Err(CommandFailure::Input(why));
    }
    write_private(Path::new(TOKEN), token.trim().as_bytes()).with_context(as_root(TOKEN))?;
    let path = Path::new(UNITS).join(UNIT);
    fs::write(&path, unit).with_context(as_root(UNITS))?;
    systemctl(["daemon-reload"])?;
    systemctl(["enable", UNIT])?;
    systemctl(["restart", UNIT])?;
    print_line(&format!("The agent stands by: {} · see it with: journalctl -u trocar-agent -f", path.display()));
    if let Some(port) = args.screen {
        print_line(&format!("The page of the box's screen: http://127.0.0.1:{port}/"));
    }
    Ok(())
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

/// Writes a file that only its owner can read, in one step.
fn write_private(path: &Path, content: &[u8]) -> std::io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("/"));
    fs::create_dir_all(folder)?;
    let new = path.with_extension("new");
    let mut file = fs::OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&new)?;
    file.set_permissions(fs::Permissions::from_mode(0o600))?; // it may be left over with others
    file.write_all(content)?;
    file.sync_all()?;
    fs::rename(new, path)
}

fn systemctl<const N: usize>(arguments: [&str; N]) -> Result<(), CommandFailure> {
    let status = Command::new("systemctl").args(arguments).status().context("running systemctl")?;
    if status.success() {
        return Ok(());
    }
    Err(CommandFailure::Failed(anyhow!("systemctl {} failed; run the command with sudo", arguments.join(" "))))
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
Wants=network-online.target
After=network-online.target

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
            options: vec![("video_size".to_owned(), "1280x720".to_owned())],
            print: true,
            source: source.to_owned(),
        }
    }

    #[test]
    fn the_unit_starts_the_agent_with_these_arguments() {
        let unit = unit(&args("/dev/video0"), Path::new("/usr/bin/trocar")).unwrap();
        let command = "ExecStart=/usr/bin/trocar agent stand-by --token-file %d/token --spool /var/lib/trocar-agent \
                       --server https://trocar.example --box box-1 --screen 8090 --key F9 \
                       --option video_size=1280x720 /dev/video0\n";
        assert!(unit.contains(command), "{unit}");
        assert!(unit.contains("LoadCredential=token:/etc/trocar/agent.token\n") && unit.contains("Restart=always\n"));
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
    fn words_are_quoted_for_systemd() {
        let quote = |word: &str| quoted(OsStr::new(word));
        assert_eq!(quote("/dev/video0").unwrap(), "/dev/video0");
        assert_eq!(quote("rtsp://a/b?c=50%&d=$x y\"z").unwrap(), r#""rtsp://a/b?c=50%%&d=$$x y\"z""#);
        for bad in ["", "a\nExecStartPre=/bin/sh", &"x".repeat(2000)] {
            assert!(quote(bad).is_err(), "{bad:?}");
        }
    }
}
