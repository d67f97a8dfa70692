//! Every dependency has a licence from `deny.toml` and comes from the package registry.

use std::process::Command;

use serde_json::Value;
use spdx::{Expression, LicenseReq, ParseMode};

/// The names of our own packages.
const OURS: [&str; 2] = ["trocar", "trocar-measurement"];

#[test]
fn every_licence_is_on_the_list() {
    let allowed = allowed_licences();
    let refused: Vec<String> = packages()
        .iter()
        .filter(|package| !is_ours(package))
        .filter(|package| !accepts(&allowed, package["license"].as_str().unwrap_or("")))
        .map(|p| format!("{} {}: {}", p["name"], p["version"], p["license"]))
        .collect();
    assert!(refused.is_empty(), "not allowed by deny.toml:\n{}", refused.join("\n"));
}

#[test]
fn a_licence_that_is_not_on_the_list_is_refused() {
    let allowed = allowed_licences();
    assert!(accepts(&allowed, "MIT OR GPL-3.0-only"));
    assert!(!accepts(&allowed, "MIT AND GPL-3.0-only"));
    assert!(!accepts(&allowed, ""));
}

#[test]
fn every_dependency_comes_from_the_registry() {
    let elsewhere: Vec<String> = packages()
        .iter()
        .filter(|p| !is_ours(p) && !p["source"].as_str().is_some_and(|s| s.starts_with("registry+")))
        .map(|p| p["name"].to_string())
        .collect();
    assert!(elsewhere.is_empty(), "not from the registry: {elsewhere:?}");
}

fn is_ours(package: &Value) -> bool {
    OURS.iter().any(|name| package["name"] == *name)
}

fn accepts(allowed: &[LicenseReq], expression: &str) -> bool {
    Expression::parse_mode(expression, ParseMode::LAX)
        .is_ok_and(|parsed| parsed.evaluate(|asked| allowed.iter().any(|have| have == asked)))
}

fn allowed_licences() -> Vec<LicenseReq> {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/deny.toml")).unwrap();
    let deny: toml::Table = text.parse().unwrap();
    let names = deny["licenses"]["allow"].as_array().unwrap();
    names.iter().map(|name| licence_requirement(name.as_str().unwrap())).collect()
}

fn licence_requirement(name: &str) -> LicenseReq {
    let parsed = Expression::parse(name).unwrap();
    let mut requirements = parsed.requirements();
    requirements.next().unwrap().req.clone()
}

fn packages() -> Vec<Value> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}
