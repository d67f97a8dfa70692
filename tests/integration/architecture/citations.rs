//! What comments and documents cite exists: sections of docs/method.md, files of this tree.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::{SOURCES, collect, read, root, shown};

/// The word that comments use to cite docs/method.md, before the number of a heading.
const CITATION: &str = "METHOD";

/// Publications that are cited by a word in capitals and a number.
const PUBLICATIONS: [&str; 1] = ["DLMF"];

/// The folders that documents name files of.
const FOLDERS: [&str; 8] =
    ["src/", "measurement/", "tests/", "docs/", "static/", "migrations/", "benches/", "systemd/"];

/// A path with one of these is a pattern, not a file.
const PLACEHOLDERS: [char; 4] = ['<', '*', '…', '{'];

#[test]
fn cited_sections_of_the_method_exist() {
    let headings = headings(&read(&root().join("docs/method.md")));
    let mut files = Vec::new();
    for folder in SOURCES.into_iter().chain(["benches", "tests"]) {
        collect(&root().join(folder), &["rs", "py", "mjs"], &mut files);
    }
    let findings = in_each(&files, |text| unknown_sections(text, &headings));
    assert!(findings.is_empty(), "\n{}\n", findings.join("\n"));
}

#[test]
fn comments_cite_no_document_outside_the_tree() {
    let mut files = Vec::new();
    SOURCES.iter().for_each(|folder| collect(&root().join(folder), &["rs"], &mut files));
    let findings = in_each(&files, foreign_documents);
    assert!(findings.is_empty(), "\n{}\n", findings.join("\n"));
}

#[test]
fn files_that_documents_name_exist() {
    let mut files = vec![root().join("README.md"), root().join("CONTRIBUTING.md")];
    for folder in ["docs", "tests", "migrations"] {
        collect(&root().join(folder), &["md"], &mut files);
    }
    files.retain(|file| !shown(file).contains("node_modules"));
    let findings: Vec<String> = files.iter().flat_map(|file| missing_files(file, &read(file))).collect();
    assert!(findings.is_empty(), "\n{}\n", findings.join("\n"));
}

#[test]
fn the_checks_find_what_they_should() {
    let headings = headings("# Title\n## 3 Regions\n### 3.2 Borders\n#### 9.1 Too deep\n## Errata\n");
    assert_eq!(headings, BTreeSet::from(["3".to_owned(), "3.2".to_owned()]));

    let cite = |after: &str| unknown_sections(&format!("//! {CITATION}{after}"), &headings);
    for good in [" 3", " 3.2.", " 3, *beyond*)", "\n//! 3.2–3", "\n    /// 3", "_NOT_ALLOWED", "=AES", "S 9"] {
        assert_eq!(cite(good), [], "{good}");
    }
    assert_eq!(cite(" 3.3"), [(1, "docs/method.md has no section 3.3".to_owned())]);
    assert_eq!(cite("\n//! 3–4").len(), 1);
    assert_eq!(cite(", last section"), [(1, "cite the number of a heading of docs/method.md".to_owned())]);
    assert_eq!(cite(" |\n//! |---|\n//! | a | 3, 3.2 |\n//! | b | 4, 3.1–3.2 |\n//! text").len(), 2);

    for foreign in ["NOTES 3.5", "(NOTES\n//! 4d)", "NOTES, finding 1"] {
        assert_eq!(foreign_documents(&format!("\n//! {foreign}")).len(), 1, "{foreign}");
    }
    for good in
        ["//! NOTES of 2010", "//! CODATA 2018, DLMF 8.17, T 4.1, RFC 9110", "const NOTES: [u8; 3];", "\"NOTES 1\""]
    {
        assert_eq!(foreign_documents(good), [], "{good}");
    }

    let document = "`src/lib.rs` `src/no.rs` `src/<noun>.rs` `cargo x`\n```\n`src/no.rs`\n```\n\
                    [a](method.md#8) [b](no.md) [c](https://x.org/no.md) ![d](../docs) [e](#here) `docs/no.md --x`";
    let missing = missing_files(&root().join("docs/x.md"), document);
    assert_eq!(
        missing,
        ["1: src/no.rs", "5: docs/no.md", "5: no.md"].map(|place| {
            let (line, path) = place.split_once(": ").unwrap();
            format!("docs/x.md:{line}: {path} does not exist")
        })
    );
}

/// Findings of `check`, a line and a rule each, as `file:line: rule`.
fn in_each(files: &[PathBuf], check: impl Fn(&str) -> Vec<(usize, String)>) -> Vec<String> {
    let in_file = |file: &PathBuf| {
        let place = shown(file);
        check(&read(file)).into_iter().map(move |(line, rule)| format!("{place}:{line}: {rule}"))
    };
    files.iter().filter(|file| !shown(file).contains("node_modules")).flat_map(in_file).collect()
}

/// The numbers of the sections of a document: `3` and `3.2`.
fn headings(document: &str) -> BTreeSet<String> {
    let title = |line: &'_ str| line.strip_prefix("## ").or_else(|| line.strip_prefix("### ")).map(str::to_owned);
    let number = |title: String| title.split(' ').next().unwrap_or_default().to_owned();
    document.lines().filter_map(title).map(number).filter(|number| number.starts_with(is_digit)).collect()
}

/// Citations of the method without a number, or with the number of no heading.
fn unknown_sections(text: &str, headings: &BTreeSet<String>) -> Vec<(usize, String)> {
    let mut findings = Vec::new();
    let unknown = |numbers: &str| -> Vec<String> {
        let numbers = numbers.split(['–', ',']).map(|number| number.trim().trim_end_matches('.'));
        numbers.filter(|number| !headings.contains(*number)).map(str::to_owned).collect()
    };
    for word in capitals(text).into_iter().filter(|word| word.text == CITATION && !word.after.starts_with(['=', '"'])) {
        let (line, after) = (word.line, words_after(word.after));
        let (lines, numbers): (Vec<usize>, Vec<String>) = if after.starts_with('|') {
            last_cells(after).into_iter().map(|(below, cell)| (line + below, cell)).unzip()
        } else {
            let is_outside = |c: char| !is_digit(c) && c != '.' && c != '–';
            (vec![line], vec![after.split(is_outside).next().unwrap_or_default().to_owned()])
        };
        for (line, number) in lines.into_iter().zip(numbers) {
            if number.is_empty() {
                findings.push((line, "cite the number of a heading of docs/method.md".to_owned()));
            } else {
                let no_section = |number| (line, format!("docs/method.md has no section {number}"));
                findings.extend(unknown(&number).into_iter().map(no_section));
            }
        }
    }
    findings
}

/// The last cell of each row of a table in a comment, and how many lines it is below the header, which `text` ends.
fn last_cells(text: &str) -> Vec<(usize, String)> {
    let rows = text.lines().enumerate().skip(2).map(|(below, line)| (below, words_after(line).trim_end()));
    let rows = rows.take_while(|(_, row)| row.starts_with('|') && row.ends_with('|'));
    rows.map(|(below, row)| (below, row.split('|').rev().nth(1).unwrap_or_default().trim().to_owned())).collect()
}

/// Words in capitals in comments that the number of a section follows: a document that readers do not have. The number
/// of a year is that of a publication.
fn foreign_documents(text: &str) -> Vec<(usize, String)> {
    let mut findings = Vec::new();
    let is_known = |word: &str| word == CITATION || PUBLICATIONS.contains(&word);
    for word in capitals(text).into_iter().filter(|word| word.is_in_comment && !is_known(word.text)) {
        let after = words_after(word.after.trim_start_matches(','));
        let after = ["section ", "finding "].iter().find_map(|noun| after.strip_prefix(noun)).unwrap_or(after);
        let digits = after.chars().take_while(|c| is_digit(*c)).count();
        if (1..4).contains(&digits) && word.text.len() >= 4 && word.after.starts_with([' ', ',', '\n']) {
            findings
                .push((word.line, format!("`{}` is not in this tree; cite a publication or our own docs", word.text)));
        }
    }
    findings
}

/// A word in capitals.
struct Capitals<'a> {
    text: &'a str,
    line: usize,
    is_in_comment: bool,
    after: &'a str,
}

fn capitals(text: &str) -> Vec<Capitals<'_>> {
    let mut found = Vec::new();
    let mut start = 0;
    for (index, line) in text.split_inclusive('\n').enumerate() {
        for word in line.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty()) {
            let at = word.as_ptr() as usize - line.as_ptr() as usize;
            if word.chars().all(|c| c.is_ascii_uppercase()) {
                let is_in_comment = line[..at].contains("//");
                let after = &text[start + at + word.len()..];
                found.push(Capitals { text: word, line: index + 1, is_in_comment, after });
            }
        }
        start += line.len();
    }
    found
}

/// The text behind spaces, line ends and the marks of comments.
fn words_after(text: &str) -> &str {
    text.trim_start_matches(|c: char| c.is_whitespace() || "/!#".contains(c))
}

/// Files that a document names in backticks or links, and that do not exist.
fn missing_files(document: &Path, text: &str) -> Vec<String> {
    let mut findings = Vec::new();
    let mut is_in_block = false;
    for (index, line) in text.lines().enumerate() {
        is_in_block ^= line.trim_start().starts_with("```");
        if is_in_block {
            continue;
        }
        let spans = line.split('`').skip(1).step_by(2).filter(|span| FOLDERS.iter().any(|f| span.starts_with(f)));
        let spans = spans.map(|span| (span, root()));
        let links = line.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next());
        let links = links.filter(|link| !link.is_empty() && !link.contains(':'));
        let links = links.map(|link| (link, document.parent().unwrap().to_owned()));
        for (path, folder) in spans.chain(links) {
            let path = path.split(' ').next().unwrap_or_default();
            if !path.contains(PLACEHOLDERS) && !folder.join(path).exists() {
                findings.push(format!("{}:{}: {path} does not exist", shown(document), index + 1));
            }
        }
    }
    findings
}

fn is_digit(c: char) -> bool {
    c.is_ascii_digit()
}
