//! The source tree keeps the rules of `src/lib.rs`: layers, forbidden names, module docs, released migrations.
//!
//! Each finding reads `file:line: rule`, so that an editor can jump there.

use std::fs;
use std::path::{Path, PathBuf};

/// A top-level module: its layer, and the names that its code must not contain.
struct Module {
    name: &'static str,
    layer: u8,
    banned: &'static [&'static str],
}

const PURE: &[&str] = &[
    "tokio",
    "axum",
    "sqlx",
    "ffmpeg_next",
    "std::fs",
    "std::net",
    "std::env",
    "std::thread",
    "std::time",
    "serde",
    "println!",
    "eprintln!",
];
const DOMAIN: &[&str] = &["tokio", "axum", "sqlx", "ffmpeg_next", "std::fs", "std::net", "std::env"];
const SERVICE: &[&str] = &["axum", "sqlx", "ffmpeg_next"];

const MODULES: &[Module] = &[
    Module { name: "time", layer: 0, banned: &["axum", "sqlx", "ffmpeg_next"] },
    Module { name: "ids", layer: 0, banned: &["axum", "ffmpeg_next"] },
    Module { name: "shutdown", layer: 0, banned: &["axum", "sqlx", "ffmpeg_next"] },
    Module { name: "heap", layer: 0, banned: &["axum", "sqlx", "ffmpeg_next", "tokio"] },
    Module { name: "random", layer: 0, banned: &["axum", "sqlx", "ffmpeg_next", "tokio"] },
    Module { name: "pipeline", layer: 1, banned: PURE },
    Module { name: "simulation", layer: 1, banned: PURE },
    Module { name: "domain", layer: 2, banned: DOMAIN },
    Module { name: "media", layer: 3, banned: &["axum", "sqlx", "tokio"] },
    Module { name: "store", layer: 3, banned: &["axum", "ffmpeg_next"] },
    Module { name: "vault", layer: 3, banned: &["axum", "sqlx", "ffmpeg_next"] },
    Module { name: "sandbox", layer: 3, banned: &["axum", "sqlx", "ffmpeg_next"] },
    Module { name: "queue", layer: 4, banned: SERVICE },
    Module { name: "analysis", layer: 4, banned: SERVICE },
    Module { name: "intake", layer: 4, banned: SERVICE },
    Module { name: "live", layer: 4, banned: SERVICE },
    Module { name: "capture", layer: 4, banned: SERVICE },
    Module { name: "cohorts", layer: 4, banned: SERVICE },
    Module { name: "rescoring", layer: 4, banned: SERVICE },
    Module { name: "events", layer: 4, banned: SERVICE },
    Module { name: "upkeep", layer: 4, banned: SERVICE },
    Module { name: "settings", layer: 5, banned: &["axum", "sqlx", "ffmpeg_next"] },
    Module { name: "http", layer: 5, banned: &["sqlx", "ffmpeg_next", "crate::pipeline"] },
    Module { name: "commands", layer: 5, banned: &["sqlx", "ffmpeg_next"] },
];

/// Adapters share a layer and must not import each other.
const ADAPTERS: [&str; 4] = ["media", "store", "vault", "sandbox"];

#[test]
fn imports_point_downwards_and_forbidden_words_stay_out() {
    let findings: Vec<String> = sources().iter().flat_map(|file| findings_in(file)).collect();
    assert!(findings.is_empty(), "\n{}\n", findings.join("\n"));
}

#[test]
fn every_file_says_what_it_is_for() {
    let undocumented: Vec<String> = sources()
        .iter()
        .filter(|file| !read(file).starts_with("//!"))
        .map(|file| format!("{}:1: begin the file with `//!` and say what it holds and why", shown(file)))
        .collect();
    assert!(undocumented.is_empty(), "\n{}\n", undocumented.join("\n"));
}

#[test]
fn released_migrations_are_untouched() {
    use sha2::{Digest, Sha256};
    let folder = root().join("migrations");
    let released = read(&folder.join("RELEASED"));
    for line in released.lines().filter(|l| !l.starts_with('#') && !l.trim().is_empty()) {
        let (hash, name) = line.split_once("  ").expect("`sha256  file` per line");
        let bytes =
            fs::read(folder.join(name)).unwrap_or_else(|_| panic!("migrations/{name}:1: released, but missing"));
        let now: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(now, hash, "migrations/{name}:1: a released migration never changes; add another");
    }
}

#[test]
fn the_check_finds_what_it_should() {
    let bad = "use crate::http::router;\nlet x = 1; // axum in a comment is fine\nlet s = \"tokio\";\nuse serde::Serialize;\n";
    let found = check("pipeline", "pipeline/x.rs", bad);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].starts_with("pipeline/x.rs:1: "));
    assert!(found[1].starts_with("pipeline/x.rs:4: "));
}

fn findings_in(file: &Path) -> Vec<String> {
    let Some(module) = module_of(file) else { return Vec::new() };
    check(module, &shown(file), &read(file))
}

fn check(module: &str, file: &str, text: &str) -> Vec<String> {
    let Some(module) = MODULES.iter().find(|m| m.name == module) else {
        return vec![format!("{file}:1: module `{module}` is on no layer; add it to src/lib.rs and to this test")];
    };
    let mut findings = Vec::new();
    for (number, line) in code_lines(text) {
        for word in module.banned.iter().filter(|w| contains_word(&line, w)) {
            findings.push(format!("{file}:{number}: `{}` must not name {word}", module.name));
        }
        let is_imported = |other: &&Module| contains_word(&line, &format!("crate::{}", other.name));
        for other in MODULES.iter().filter(|other| other.name != module.name).filter(is_imported) {
            let are_adapters = ADAPTERS.contains(&module.name) && ADAPTERS.contains(&other.name);
            if other.layer > module.layer || are_adapters {
                findings.push(format!(
                    "{file}:{number}: `{}` (layer {}) must not import `{}` (layer {})",
                    module.name, module.layer, other.name, other.layer
                ));
            }
        }
    }
    findings
}

/// Lines of code with their numbers, without comments, string contents and test modules.
fn code_lines(text: &str) -> Vec<(usize, String)> {
    let mut lines = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("#[cfg(test)]") {
            break; // tests come last in a file and may use anything
        }
        lines.push((index + 1, without_text(line)));
    }
    lines
}

fn without_text(line: &str) -> String {
    let mut code = String::new();
    let mut in_text = false;
    let mut before = ' ';
    for (at, c) in line.char_indices() {
        if !in_text && line[at..].starts_with("//") {
            break;
        }
        if c == '"' && before != '\\' && before != '\'' {
            in_text = !in_text;
        } else if !in_text {
            code.push(c);
        }
        before = c;
    }
    code
}

/// True if the line contains `word` as a whole word.
fn contains_word(line: &str, word: &str) -> bool {
    line.match_indices(word).any(|(at, _)| {
        let edge = |c: Option<char>| c.is_none_or(|c| !c.is_alphanumeric() && c != '_');
        edge(line[..at].chars().next_back()) && edge(line[at + word.len()..].chars().next())
    })
}

fn module_of(file: &Path) -> Option<&str> {
    let inside = file.strip_prefix(root().join("src")).ok()?;
    let first = Path::new(inside.components().next()?.as_os_str()).file_stem()?.to_str()?;
    let known = MODULES.iter().find(|r| r.name == first).map(|r| r.name);
    match first {
        "lib" | "main" => None,
        _ => Some(known.unwrap_or("unknown")),
    }
}

fn sources() -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![root().join("src")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("src is readable").flatten() {
            let path = entry.path();
            match path.is_dir() {
                true => folders.push(path),
                false if path.extension().is_some_and(|e| e == "rs") && !is_unit_test(&path) => files.push(path),
                false => {}
            }
        }
    }
    files.sort();
    files
}

/// `tests.rs` and `tests/…` hold only unit tests, which may use anything.
fn is_unit_test(path: &Path) -> bool {
    path.file_stem().is_some_and(|stem| stem == "tests") || path.iter().any(|part| part == "tests")
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn shown(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}
