//! What tests use beside the code: shared reference data, programs, rights. A test that lacks one of them is skipped, and
//! says so even though it passes.
//!
//! The tests beside the code include this file, too.

use std::fmt::Display;
use std::fs::OpenOptions;
use std::io::{Write, stderr};
use std::path::{Path, PathBuf};

/// Reports that a test, or a part of it, is skipped because something is missing.
///
/// Prints a line that the test harness does not capture, and adds it to the file that `TROCAR_SKIPS` names, for
/// `make test` to count.
///
/// # Panics
/// With `TROCAR_MUST_NOT_SKIP=1`.
pub fn skip(missing: impl Display) {
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    let line = format!("SKIPPED {test}: {missing}\n");
    stderr().write_all(line.as_bytes()).unwrap();
    if let Some(list) = std::env::var_os("TROCAR_SKIPS") {
        OpenOptions::new().create(true).append(true).open(list).unwrap().write_all(line.as_bytes()).unwrap();
    }
    assert!(std::env::var_os("TROCAR_MUST_NOT_SKIP").is_none_or(|value| value != "1"), "{line}");
}

/// A part of the shared reference data, in the folder that `TROCAR_SHARED` names or in `shared` beside the checkout.
/// `None` without it; the caller's test is then reported as skipped.
pub fn shared(part: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let named = std::env::var_os("TROCAR_SHARED").map(PathBuf::from);
    let places = named.into_iter().chain(["../shared", "../../shared"].map(|place| root.join(place)));
    let found = places.map(|place| place.join(part)).find(|part| part.exists());
    if found.is_none() {
        skip(format_args!("no {part} in the shared reference data; TROCAR_SHARED names their folder"));
    }
    found
}
