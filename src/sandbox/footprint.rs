//! Memory use of a process, as reported by the kernel.

use std::fs;
use std::io;

/// A field such as `VmHWM` of a process's `status` file, bytes. `process` is a process number or `self`.
pub(super) fn memory_field(process: &str, field: &str) -> io::Result<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status"))?;
    read_field(&status, field).ok_or_else(|| io::Error::other(format!("no {field} in the process's status")))
}

fn read_field(status: &str, field: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix(field)?.strip_prefix(':'))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_found_by_its_whole_name() {
        let status = "Name:\tx\nVmPeak:\t  900 kB\nVmSize:\t  800 kB\n";
        assert_eq!(read_field(status, "VmSize"), Some(800 * 1024));
        assert_eq!(read_field(status, "Vm"), None);
    }

    #[test]
    fn this_process_takes_memory() {
        assert!(memory_field("self", "VmSize").unwrap() > 1 << 20);
    }
}
