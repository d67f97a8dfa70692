//! `migrations/RELEASED` has the hash of each migration that a release has carried, and lacks none of them.

use std::fs;

use sha2::{Digest, Sha256};

use super::{read, root};

/// A line with the hash and the name of a released migration, as `sha256sum` prints it.
fn entries(released: &str) -> impl Iterator<Item = (&str, &str)> {
    let lines = released.lines().filter(|line| !line.starts_with('#') && !line.trim().is_empty());
    lines.map(|line| line.split_once("  ").expect("`sha256  file` per line"))
}

/// The names of all migrations, in their order.
fn migrations() -> Vec<String> {
    let names = fs::read_dir(root().join("migrations")).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> = names.map(|name| name.into_string().unwrap()).collect();
    names.retain(|name| name.ends_with(".sql"));
    names.sort();
    names
}

/// The versions that the changelog has, newest first, and whether it has changes that no release carries yet.
fn releases(changelog: &str) -> (Vec<&str>, bool) {
    let sections = changelog.split("\n## ").skip(1);
    let sections = sections.map(|section| section.split_once('\n').unwrap_or((section, "")));
    let (unreleased, released): (Vec<_>, Vec<_>) = sections.partition(|(heading, _)| *heading == "Unreleased");
    let versions = released.into_iter().map(|(heading, _)| version_of(heading)).collect();
    (versions, unreleased.iter().any(|(_, changes)| !changes.trim().is_empty()))
}

/// The version in a heading such as `1.0.0 - 2027-01-15` or `[1.0.0]`.
fn version_of(heading: &str) -> &str {
    heading.split_once(' ').map_or(heading, |(version, _)| version).trim_matches(['[', ']'])
}

/// What the list of released migrations lacks.
fn missing(changelog: &str, released: &str, migrations: &[&str]) -> Vec<String> {
    let (versions, is_changed) = releases(changelog);
    let has_line = |version: &&str| released.lines().any(|line| line == format!("# {version}"));
    let unlisted = versions.into_iter().filter(|version| !has_line(version));
    let mut found: Vec<String> = unlisted.map(|version| format!("`# {version}`, then its migrations")).collect();
    let listed: Vec<&str> = entries(released).map(|(_, name)| name).collect();
    let newest = listed.iter().max();
    let must_be_listed = |name: &&str| !is_changed || newest.is_some_and(|newest| name < newest);
    let left_out = migrations.iter().copied().filter(must_be_listed).filter(|name| !listed.contains(name));
    found.extend(left_out.map(str::to_owned));
    found
}

#[test]
fn released_migrations_are_untouched() {
    let folder = root().join("migrations");
    let released = read(&folder.join("RELEASED"));
    assert!(entries(&released).count() > 0, "migrations/RELEASED:1: lists no migration");
    for (hash, name) in entries(&released) {
        let bytes =
            fs::read(folder.join(name)).unwrap_or_else(|_| panic!("migrations/{name}:1: released, but missing"));
        let now: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(now, hash, "migrations/{name}:1: a released migration never changes; add another");
    }
}

#[test]
fn every_migration_of_a_release_is_listed() {
    let (changelog, released) = (read(&root().join("CHANGELOG.md")), read(&root().join("migrations/RELEASED")));
    let migrations = migrations();
    let migrations: Vec<&str> = migrations.iter().map(String::as_str).collect();
    let missing = missing(&changelog, &released, &migrations);
    assert!(missing.is_empty(), "add to migrations/RELEASED, with the lines of `sha256sum`: {missing:#?}");
}

#[test]
fn a_release_that_the_list_lacks_is_found() {
    let all = ["0001_a.sql", "0002_b.sql", "0003_c.sql"];
    let open = "# Changelog\n\n## Unreleased\n\n- More.\n";
    let begun = "# Changelog\n\n## Unreleased\n\n## [0.2.0] - 2027-01-15\n\n- Much.\n";
    let first = "# Changelog\n\n## 0.2.0 - 2027-01-15\n\n- Much.\n";
    let (two, three) = ("# 0.2.0\nab  0001_a.sql\ncd  0002_b.sql\n", "# 0.2.0\nab  0001_a.sql\ncd  0003_c.sql\n");
    assert_eq!(missing(open, two, &all), Vec::<String>::new(), "the third belongs to the next release");
    assert_eq!(missing(open, three, &all), ["0002_b.sql"]);
    for at_release in [begun, first] {
        assert_eq!(missing(at_release, two, &all), ["0003_c.sql"]);
        assert_eq!(
            missing(at_release, &two.replace("# 0.2.0", "# 0.1.0"), &all[..2]),
            ["`# 0.2.0`, then its migrations"]
        );
    }
}
