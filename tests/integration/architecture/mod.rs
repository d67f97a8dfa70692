//! The source tree keeps the rules of `src/lib.rs`: layers, forbidden names, module docs.
//!
//! Each finding reads `file:line: rule`, so that an editor can jump there.

mod citations;
mod paths;
mod releases;

use std::fs;
use std::path::{Path, PathBuf};

use paths::{Mention, mentions, module_of};

/// The folders of our two crates' sources, `trocar` and `measurement`.
const SOURCES: [&str; 2] = ["src", "measurement/src"];

/// A top-level module and its limits.
struct Module {
    name: &'static str,
    /// A module may use the layers below its own.
    layer: u8,
    /// What it may use of its own layer: modules, or parts of them.
    beside: &'static [&'static str],
    /// Crates, modules of `std` and macros that its code must not name.
    banned: &'static [&'static [&'static str]],
}

const RUNTIME: &[&str] = &["tokio", "tokio_stream", "tokio_tungstenite", "tokio_util", "futures_util"];
const WEB: &[&str] = &["axum", "axum_extra", "hyper", "hyper_util", "http_body_util", "tower", "tower_http"];
/// The parts of [`WEB`] that only a server needs.
const SERVER: &[&str] = &["axum", "axum_extra", "tower", "tower_http"];
const DATABASE: &[&str] = &["sqlx"];
const VIDEO: &[&str] = &["ffmpeg_next"];
/// The science may derive serde's traits, since its types travel between processes; it reads and writes no format.
const FORMATS: &[&str] = &["serde_json", "csv", "parquet", "postcard", "toml", "base64", "image"];
const OUTSIDE: &[&str] = &["std::fs", "std::net", "std::env"];
const MACHINE: &[&str] = &["std::thread", "std::time", "std::process", "std::os", "jiff", "libc", "rustix"];
const OUTPUT: &[&str] = &["print!", "println!", "eprint!", "eprintln!", "dbg!", "tracing", "metrics"];

const PURE: &[&[&str]] = &[RUNTIME, WEB, DATABASE, VIDEO, FORMATS, OUTSIDE, MACHINE, OUTPUT];
const DOMAIN: &[&[&str]] = &[RUNTIME, WEB, DATABASE, VIDEO, OUTSIDE];
const SERVICE: &[&[&str]] = &[WEB, DATABASE, VIDEO];

/// The modules of the science. `http` shows stored results and computes none.
const SCIENCE: [&str; 6] = ["numbers", "vision", "motion", "statistics", "simulation", "checks"];
const SERVICES: &[&str] = &[
    "queue",
    "analysis",
    "intake",
    "live",
    "capture",
    "certificates",
    "cohorts",
    "rescoring",
    "events",
    "access_log",
    "box_agents",
    "upkeep",
];
const RIM: &[&str] = &["http", "commands", "settings"];
/// What a simulated camera delivers and where things are; not how the tracker finds them.
const SCENE: &[&str] = &["vision::camera", "vision::space", "vision::frame", "vision::trajectory"];

const MODULES: &[Module] = &[
    Module { name: "time", layer: 0, beside: &[], banned: &[WEB, DATABASE, VIDEO] },
    Module { name: "ids", layer: 0, beside: &[], banned: &[WEB, DATABASE, VIDEO] },
    Module { name: "shutdown", layer: 0, beside: &[], banned: &[WEB, DATABASE, VIDEO] },
    Module { name: "heap", layer: 0, beside: &[], banned: &[RUNTIME, WEB, DATABASE, VIDEO] },
    Module { name: "random", layer: 0, beside: &[], banned: &[RUNTIME, WEB, DATABASE, VIDEO] },
    Module { name: "numbers", layer: 1, beside: &[], banned: PURE },
    Module { name: "vision", layer: 1, beside: &["numbers"], banned: PURE },
    Module { name: "motion", layer: 1, beside: &["numbers", "vision"], banned: PURE },
    Module { name: "statistics", layer: 1, beside: &["numbers", "vision", "motion"], banned: PURE },
    Module { name: "simulation", layer: 1, beside: SCENE, banned: PURE },
    Module { name: "checks", layer: 1, beside: &SCIENCE, banned: PURE },
    Module { name: "domain", layer: 2, beside: &[], banned: DOMAIN },
    Module { name: "media", layer: 3, beside: &[], banned: &[RUNTIME, WEB, DATABASE] },
    Module { name: "store", layer: 3, beside: &[], banned: &[WEB, VIDEO] },
    Module { name: "vault", layer: 3, beside: &[], banned: &[WEB, DATABASE, VIDEO] },
    Module { name: "identity_provider", layer: 3, beside: &[], banned: &[SERVER, DATABASE, VIDEO] },
    Module { name: "sandbox", layer: 3, beside: &[], banned: &[WEB, DATABASE, VIDEO] },
    Module { name: "queue", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "analysis", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "intake", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "live", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "capture", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "certificates", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "cohorts", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "rescoring", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "events", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "access_log", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "box_agents", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "upkeep", layer: 4, beside: SERVICES, banned: SERVICE },
    Module { name: "settings", layer: 5, beside: RIM, banned: &[WEB, DATABASE, VIDEO] },
    Module { name: "http", layer: 5, beside: RIM, banned: &[DATABASE, VIDEO] },
    Module { name: "commands", layer: 5, beside: RIM, banned: &[DATABASE, VIDEO] },
    Module { name: "main", layer: 5, beside: RIM, banned: &[WEB, DATABASE, VIDEO] },
];

/// The stages of `vision` in their order, after the types that all of them share. A stage uses no later one.
const STAGES: [&[&str]; 10] = [
    &["camera", "space", "frame", "tube", "reason"],
    &["surroundings"],
    &["segmentation"],
    &["blob", "strip"],
    &["edges"],
    &["pose"],
    &["filter"],
    &["trajectory"],
    &["reference", "still"],
    &["tracker"],
];

#[test]
fn imports_point_downwards_and_forbidden_names_stay_out() {
    let sources = sources();
    let findings = findings(&sources);
    assert!(findings.is_empty(), "\n{}\n", findings.join("\n"));
    for module in MODULES {
        let is_present = |file: &str| module_of(file).first().is_some_and(|name| name == module.name);
        assert!(sources.iter().any(|(file, _)| is_present(file)), "`{}` is listed here, but missing", module.name);
    }
}

#[test]
fn every_file_says_what_it_is_for() {
    let undocumented: Vec<String> = sources()
        .iter()
        .filter(|(file, text)| !is_unit_test(file) && !text.starts_with("//!"))
        .map(|(file, _)| format!("{file}:1: begin the file with `//!` and say what it holds and why"))
        .collect();
    assert!(undocumented.is_empty(), "\n{}\n", undocumented.join("\n"));
}

/// A line, and a part of the rule that it breaks.
type Finding = (usize, &'static str);

/// Files that break rules: path, code, findings.
const PLANTED: &[(&str, &str, &[Finding])] = &[
    ("vision/x.rs", "use crate::http::router;", &[(1, "`vision` (layer 1) must not use `crate::http::router`")]),
    ("vision/blob/x.rs", "fn f() {\n super::super::super::store::open();\n}", &[(2, "`crate::store::open`")]),
    ("vision/blob/x.rs", "use super::super::super::motion as m;", &[(1, "must not use `crate::motion`")]),
    (
        "motion/x.rs",
        "use crate::{\n random::Seed,\n statistics::{self, curve},\n};",
        &[(3, "`crate::statistics`"), (3, "`crate::statistics::curve`")],
    ),
    ("motion/x.rs", "#[cfg(test)]\nmod tests {}\nuse tokio::sync;", &[(3, "`motion` must not name tokio")]),
    (
        "motion/x.rs",
        "#[cfg(test)]\nuse tokio::a;\nfn f(path: &std::path::Path) { std::fs::read(path); }",
        &[(3, "must not name std::fs")],
    ),
    ("numbers/x.rs", "fn f() {\n assert!(a,\n \"{}\", crate::vision::frame::WIDTH);\n}", &[(3, "`crate::vision")]),
    (
        "numbers/x.rs",
        "macro_rules! m { () => { use crate::{motion::a, random}; $crate::checks::b() } }",
        &[(1, "`crate::motion::a`"), (1, "`crate::checks::b`")],
    ),
    ("vision/tube.rs", "mod inner {\n fn f() { super::super::super::domain::f(); }\n}", &[(2, "`crate::domain::f`")]),
    (
        "vision/tube.rs",
        "mod inner {\n use super::*;\n fn f() { clock::now(); }\n}\nuse std::time as clock;",
        &[(3, "must not name std::time"), (5, "must not name std::time")],
    ),
    (
        "vision/x.rs",
        "fn f() { println!(); std::eprintln!(); g(|| vec![dbg!(1)]) }",
        &[(1, "must not name println!"), (1, "must not name eprintln!"), (1, "must not name dbg!")],
    ),
    (
        "vision/x.rs",
        "struct A {\n #[serde(with = \"crate::domain::text\")]\n b: u8,\n c: Vec<serde_json::Value>,\n}",
        &[(2, "`crate::domain::text`"), (4, "must not name serde_json")],
    ),
    ("vision/pose/x.rs", "use crate::vision::{edges, tracker::Tracker};", &[(1, "`pose` must not use `tracker`")]),
    ("vision/edges/x.rs", "use super::super as all;\nfn f() { all::pose::g(); }", &[(2, "must not use `pose`")]),
    ("vision/reference/x.rs", "use crate::vision::tracker::Tracker;", &[(1, "`reference` must not use `tracker`")]),
    ("vision/new.rs", "use crate::vision::frame::Frame;", &[(1, "`new` is no stage")]),
    (
        "simulation/x.rs",
        "use crate::vision::{camera::Camera, segmentation::Palette};",
        &[(1, "segmentation::Palette`")],
    ),
    ("simulation/x.rs", "use crate::vision;", &[(1, "`crate::vision`")]),
    ("media/x.rs", "use crate::store::Store;\nuse sqlx::Row;", &[(1, "`crate::store"), (2, "must not name sqlx")]),
    ("store/x.rs", "use ffmpeg_next as ff;", &[(1, "must not name ffmpeg_next")]),
    ("domain/x.rs", "impl A { fn f() -> ::std::net::IpAddr { b } }", &[(1, "must not name std::net")]),
    ("queue/x.rs", "#[axum::debug_handler]\nfn f() {}", &[(1, "must not name axum")]),
    ("http/x.rs", "use crate::numbers::quantile::Quantile;", &[(1, "`http` must not use the science")]),
    ("http/x.rs", "use measurement::vision::frame::Frame;", &[(1, "`http` must not use the science")]),
    ("http/x.rs", "use crate as all;", &[(1, "name the module")]),
    ("analysis/x.rs", "use crate::motion::assessment::assess;", &[(1, "must leave scoring to a child")]),
    ("analysis/x.rs", "use super::scoring::score_tracked;", &[(1, "must leave scoring to a child")]),
    ("heap.rs", "use crate::random::Seed;", &[(1, "`heap` (layer 0) must not use `crate::random::Seed`")]),
    ("main.rs", "use trocar::unknown::A;", &[(1, "`unknown` is on no layer")]),
    ("unknown/mod.rs", "use std::fmt;", &[(1, "`unknown` is on no layer")]),
    ("lib.rs", "pub use vision::Frame;\npub mod vision;", &[(1, "`lib` re-exports only whole modules")]),
];

/// Code that keeps the rules.
const CLEAN: &[(&str, &str)] = &[
    ("vision/x.rs", "// use axum;\n//! See [`crate::http`].\nconst S: &str = \"tokio::spawn\";"),
    ("vision/x.rs", "#[derive(serde::Serialize)]\n#[serde(rename_all = \"snake_case\")]\nstruct A;"),
    ("vision/x.rs", "#[cfg(test)]\nmod checks_of_x { use crate::http::router; }\nmod tests { use tokio::sync; }"),
    ("vision/x.rs", "impl A { #[cfg(test)] fn f() { std::fs::read(a) } }"),
    ("vision/x/tests.rs", "use crate::simulation::World; fn f() { println!() }"),
    ("vision/x.rs", "fn f(csv: f64, image: f64) -> f64 { if csv != (image) { csv } else { vec![image][0] } }"),
    ("motion/x.rs", "use crate::vision::trajectory::Sample;\nuse crate::numbers::quantile;\nuse super::features;"),
    ("simulation/motion.rs", "use super::world::World;\nuse crate::vision::space::Pixel;"),
    ("checks/x.rs", "use crate::{numbers, simulation, statistics, vision};"),
    ("vision/tracker/x.rs", "use super::super::{pose, trajectory};\nuse crate::vision::filter::{self};"),
    ("http/x.rs", "use axum::Json;\nuse crate::{settings, store, upkeep};\nuse crate::domain::motion;"),
    ("commands/x.rs", "fn f() { println!(); crate::vision::tracker::g() }"),
    ("lib.rs", "pub use measurement::{motion, vision};\npub mod http;"),
];

#[test]
fn the_check_finds_what_it_should() {
    for (file, code, expected) in PLANTED {
        let found = findings_of_one(file, code);
        assert_eq!(found.len(), expected.len(), "{file}: {code}\n{found:#?}");
        for (found, (line, rule)) in found.iter().zip(*expected) {
            assert!(found.starts_with(&format!("src/{file}:{line}: ")) && found.contains(rule), "{found}\n{rule}");
        }
    }
    for (file, code) in CLEAN {
        assert_eq!(findings_of_one(file, code), Vec::<String>::new(), "{file}: {code}");
    }
}

#[test]
fn files_that_are_declared_for_tests_are_left_out() {
    let world = ("measurement/src/vision/testing.rs".to_owned(), "use crate::simulation::World;".to_owned());
    let declared = |text: &str| ("measurement/src/vision/mod.rs".to_owned(), text.to_owned());
    assert_eq!(findings(&[declared("#[cfg(test)]\npub(crate) mod testing;"), world.clone()]), Vec::<String>::new());
    assert_eq!(findings(&[declared("pub(crate) mod testing;"), world]).len(), 1);
}

fn findings_of_one(file: &str, code: &str) -> Vec<String> {
    findings(&[(format!("src/{file}"), code.to_owned())])
}

fn findings(sources: &[(String, String)]) -> Vec<String> {
    let broken = |mention: &Mention| {
        let rules =
            [forbidden_name(mention), forbidden_layer(mention), forbidden_stage(mention), forbidden_scoring(mention)];
        rules.into_iter().flatten().map(|rule| format!("{}:{}: {rule}", mention.file, mention.line)).collect()
    };
    let mut findings: Vec<String> = mentions(sources).iter().flat_map::<Vec<String>, _>(broken).collect();
    findings.dedup();
    findings
}

fn forbidden_name(mention: &Mention) -> Option<String> {
    let module = listed(mention.module.first()?)?;
    let names: Vec<&str> = mention.path.iter().map(String::as_str).collect();
    let is_named = |word: &&&str| match word.ends_with('!') {
        true => names.last() == Some(word),
        false => names.starts_with(&word.split("::").collect::<Vec<_>>()),
    };
    let word = module.banned.iter().copied().flatten().find(is_named)?;
    Some(format!("`{}` must not name {word}", module.name))
}

fn forbidden_layer(mention: &Mention) -> Option<String> {
    let unlisted = |name: &str| Some(format!("`{name}` is on no layer; add it to src/lib.rs and to this test"));
    let Some(from) = mention.module.first() else {
        let is_inside_module = mention.path.len() > 2 && mention.path[0] == "crate";
        return is_inside_module.then(|| "`lib` re-exports only whole modules".to_owned());
    };
    let Some(from) = listed(from) else { return unlisted(from) };
    let path = mention.path.strip_prefix(&["crate".to_owned()])?;
    let Some(to) = path.first() else { return Some("name the module, not the whole crate".to_owned()) };
    let Some(to) = listed(to) else { return unlisted(to) };
    if from.name == "http" && SCIENCE.contains(&to.name) {
        return Some(format!("`http` must not use the science: `{}`", mention.path.join("::")));
    }
    let is_beside = |part: &&str| path.starts_with(&part.split("::").map(str::to_owned).collect::<Vec<_>>());
    let may_use =
        to.layer < from.layer || to.name == from.name || to.layer == from.layer && from.beside.iter().any(is_beside);
    (!may_use).then(|| format!("`{}` (layer {}) must not use `{}`", from.name, from.layer, mention.path.join("::")))
}

fn forbidden_stage(mention: &Mention) -> Option<String> {
    let ["vision", from, ..] = &mention.module.iter().map(String::as_str).collect::<Vec<_>>()[..] else { return None };
    let ["crate", "vision", to, ..] = &mention.path.iter().map(String::as_str).collect::<Vec<_>>()[..] else {
        return None;
    };
    let order = |stage: &str| STAGES.iter().position(|stages| stages.contains(&stage));
    match (order(from), order(to)) {
        (None, _) => Some(format!("`{from}` is no stage of `vision`; add it to this test")),
        (Some(earlier), Some(later)) if later > earlier => Some(format!("`{from}` must not use `{to}`, a later stage")),
        _ => None,
    }
}

/// Scoring a long path takes hundreds of MiB, so the service leaves it to children.
fn forbidden_scoring(mention: &Mention) -> Option<String> {
    let module: Vec<&str> = mention.module.iter().map(String::as_str).collect();
    let is_allowed = match mention.path.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["crate", "motion", "assessment", ..] => module.starts_with(&["analysis", "scoring"]),
        ["crate", "analysis", "scoring", function, ..] if function.starts_with("score_") => {
            module.starts_with(&["analysis", "child"])
        }
        _ => return None,
    };
    let is_service = listed(module.first()?).is_some_and(|from| from.layer >= 3 && from.name != "commands");
    (is_service && !is_allowed).then(|| format!("`{}` must leave scoring to a child", mention.path.join("::")))
}

fn listed(module: &str) -> Option<&'static Module> {
    MODULES.iter().find(|listed| listed.name == module)
}

/// The Rust files of the program: the path, and the text.
fn sources() -> Vec<(String, String)> {
    let mut files = Vec::new();
    SOURCES.iter().for_each(|folder| collect(&root().join(folder), &["rs"], &mut files));
    files.iter().map(|file| (shown(file), read(file))).collect()
}

/// `tests.rs` and `tests/…` hold only unit tests.
fn is_unit_test(file: &str) -> bool {
    file.split('/').any(|part| part == "tests" || part == "tests.rs")
}

/// Adds the files with these extensions, in order of their names.
fn collect(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            collect(&path, extensions, found);
        } else if path.extension().is_some_and(|extension| extensions.iter().any(|wanted| extension == *wanted)) {
            found.push(path);
        }
    }
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
