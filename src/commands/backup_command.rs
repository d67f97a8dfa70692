//! The command that makes a backup by hand, as the page *Service* prints it for a shell.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, access};

use crate::sandbox::Program;
use crate::settings::Settings;

/// Name of the backup's folder in the folder of the scheduled backups.
const BY_HAND: &str = "by-hand";

/// The command for the data folder of these settings.
pub(super) fn backup_command(settings: &Settings, program: &Program) -> String {
    let data = settings.data.canonicalize().unwrap_or_else(|_| settings.data.clone());
    let program = program.file().unwrap_or_else(|| PathBuf::from("trocar"));
    let owner = fs::metadata(&data).map_or(0, |found| found.uid());
    command(&program, &data, settings.backup.target.as_deref(), owner, |folder| {
        access(folder, Access::WRITE_OK).is_ok()
    })
}

/// The backup lies in the folder of the scheduled backups, if there is one, else beside the data folder. If the service's
/// user cannot make it there, the command does so for the owner of the data folder, named by number.
fn command(
    program: &Path,
    data: &Path,
    scheduled: Option<&Path>,
    owner: u32,
    is_writable: impl Fn(&Path) -> bool,
) -> String {
    let beside = || {
        let mut name = data.as_os_str().to_owned();
        name.push("-backup");
        PathBuf::from(name)
    };
    let target = scheduled.map_or_else(beside, |folder| folder.join(BY_HAND));
    let words = [program, Path::new("admin"), Path::new("--data"), data, Path::new("backup"), &target];
    let backup = words.map(quote).join(" ");
    if scheduled.is_some() || target.parent().is_some_and(is_writable) {
        return backup;
    }
    format!("sudo install -d -o {owner} -m 0700 {} && sudo -u '#{owner}' {backup}", quote(&target))
}

/// A word for a shell.
fn quote(word: &Path) -> String {
    let word = word.display().to_string();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+".contains(c);
    if word.chars().all(is_plain) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_a_backup_can_be_made_by_the_user_who_runs_the_command() {
        let of = |scheduled: Option<&str>, is_writable| {
            let (program, data) = (Path::new("/usr/bin/trocar"), Path::new("/var/lib/tro car"));
            command(program, data, scheduled.map(Path::new), 998, |folder| {
                assert_eq!(folder, Path::new("/var/lib"));
                is_writable
            })
        };
        let beside = "/usr/bin/trocar admin --data '/var/lib/tro car' backup '/var/lib/tro car-backup'";
        assert_eq!(of(None, true), beside);
        let prepared = "sudo install -d -o 998 -m 0700 '/var/lib/tro car-backup' && sudo -u '#998'";
        assert_eq!(of(None, false), format!("{prepared} {beside}"));
        let scheduled = "/usr/bin/trocar admin --data '/var/lib/tro car' backup /backup/by-hand";
        assert_eq!(of(Some("/backup"), false), scheduled);
    }
}
