//! Text is plain, names are unique, functions are short: counts with limits that may only fall.
//!
//! CONTRIBUTING.md has the rules. A count that falls well below its limit fails, too: lower the limit then, so that the
//! improvement stays.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use syn::spanned::Spanned;
use syn::visit::Visit;

/// Phrases that make a sentence hard to read, and how often all texts together may use them.
const PHRASES: [(&str, &[&str], usize); 4] = [
    ("persons without a name", &["whoever", "whatever", "whom", "somebody", "nobody", "whichever"], 0),
    ("tell instead of say, show or report", &["told", "tell", "tells", "telling"], 0),
    (
        "relative clauses by preposition",
        &["of which", "to which", "by which", "with which", "from which", "in which", "as far as"],
        0,
    ),
    (
        "vague verbs",
        &[
            "what came",
            "came of",
            "what comes",
            "what is asked",
            "what is told",
            "what is said",
            "what is meant",
            "goes on",
            "is made of",
            "stands at",
            "stands in",
            "stands for",
            "stands on",
        ],
        0,
    ),
];

/// A count may be this far below its limit before the limit must be lowered.
const SLACK: usize = 5;

/// Lines of a function: median, nine of ten, longest.
const MAX_FUNCTION_LINES: [usize; 3] = [8, 22, 80];

#[test]
fn texts_avoid_the_phrases_that_make_sentences_hard_to_read() {
    let texts: Vec<(PathBuf, String)> = files().into_iter().flat_map(|file| texts(&file)).collect();
    for (name, phrases, limit) in PHRASES {
        let found: Vec<String> = texts.iter().flat_map(|(file, text)| uses(file, text, phrases)).collect();
        let list = found.join("\n");
        assert!(found.len() <= limit, "{name}: {} uses, at most {limit}; see CONTRIBUTING.md\n{list}", found.len());
        assert!(found.len() + SLACK >= limit, "{name}: only {} uses are left: lower the limit of {limit}", found.len());
    }
}

#[test]
fn each_type_has_a_name_of_its_own() {
    let mut files_by_name: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in product_files() {
        for name in type_names(&parsed(&file).items) {
            files_by_name.entry(name).or_default().push(shown(&file));
        }
    }
    let shared: Vec<String> = files_by_name
        .iter()
        .filter(|(_, files)| files.len() > 1)
        .map(|(name, files)| format!("{name}: {}", files.join(", ")))
        .collect();
    assert!(shared.is_empty(), "types share a name; qualify them:\n{}", shared.join("\n"));
}

#[test]
fn functions_are_short() {
    let mut lengths = FunctionLengths::default();
    for file in product_files() {
        lengths.file = shown(&file);
        lengths.visit_file(&parsed(&file));
    }
    let mut all = lengths.found;
    all.sort();
    let measured = [all[all.len() / 2].0, all[all.len() * 9 / 10].0, all[all.len() - 1].0];
    let longest: Vec<String> = all.iter().rev().take(5).map(|(lines, name)| format!("{name}: {lines}")).collect();
    for (measured, limit) in measured.into_iter().zip(MAX_FUNCTION_LINES) {
        assert!(
            measured <= limit,
            "median, nine of ten, longest: {measured:?} lines, at most {limit}\n{}",
            longest.join("\n")
        );
    }
}

#[test]
fn the_checks_find_what_they_should() {
    let text = "Somebody said of whom; nobody's tellings. What came? Outcome of it goes  on.";
    assert_eq!(uses(Path::new("x"), text, PHRASES[0].1).len(), 3);
    assert_eq!(uses(Path::new("x"), text, PHRASES[1].1).len(), 0);
    assert_eq!(uses(Path::new("x"), text, PHRASES[3].1).len(), 1);
    let source = "struct A; mod tests { struct B; } #[cfg(test)] mod more { struct C; } mod inner { enum D {} }";
    assert_eq!(type_names(&syn::parse_file(source).unwrap().items), ["A", "D"]);
}

/// Places where a phrase is used, as `file: words around it`.
fn uses(file: &Path, text: &str, phrases: &[&str]) -> Vec<String> {
    let text = text.to_lowercase();
    let is_word = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    let mut found = Vec::new();
    for phrase in phrases {
        for (at, _) in text.match_indices(phrase) {
            let (before, after) = (&text[..at], &text[at + phrase.len()..]);
            if !is_word(before.chars().next_back()) && !is_word(after.chars().next()) {
                let before: String = before.chars().rev().take(40).collect::<Vec<_>>().into_iter().rev().collect();
                let after: String = after.chars().take(40).collect();
                let around = format!("{before}{phrase}{after}").split_whitespace().collect::<Vec<_>>().join(" ");
                found.push(format!("{}: {around}", shown(file)));
            }
        }
    }
    found
}

/// The parts of a file that people read: comments, documents, and the words of the pages.
fn texts(file: &Path) -> Vec<(PathBuf, String)> {
    let text = fs::read_to_string(file).unwrap();
    let extension = file.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let after = |mark: &'static str| text.lines().filter_map(move |line| Some(line.split_once(mark)?.1.to_owned()));
    let parts: Vec<String> = match extension {
        "md" => vec![text],
        "sql" => after("--").collect(),
        "rs" => after("//").collect(),
        "js" | "mjs" => {
            let blocks = text.split("/*").skip(1).map(|block| block.split("*/").next().unwrap_or_default().to_owned());
            let words = if file.ends_with("texts/en.js") { quoted(&text) } else { Vec::new() };
            after("//").chain(blocks).chain(words).collect()
        }
        _ => Vec::new(),
    };
    parts.into_iter().map(|part| (file.to_owned(), part)).collect()
}

/// What stands between single quotes or backticks.
fn quoted(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find(['\'', '`']) {
        let quote = if rest[start..].starts_with('`') { '`' } else { '\'' };
        let Some(length) = rest[start + 1..].find(quote) else { break };
        found.push(rest[start + 1..][..length].to_owned());
        rest = &rest[start + length + 2..];
    }
    found
}

/// Lengths of functions with a body, signature included.
#[derive(Default)]
struct FunctionLengths {
    file: String,
    found: Vec<(usize, String)>,
}

impl FunctionLengths {
    fn add(&mut self, signature: &syn::Signature, body: &syn::Block) {
        let lines = body.span().end().line - signature.span().start().line + 1;
        self.found.push((lines, format!("{}: {}", self.file, signature.ident)));
    }
}

impl<'ast> Visit<'ast> for FunctionLengths {
    fn visit_item_fn(&mut self, function: &'ast syn::ItemFn) {
        self.add(&function.sig, &function.block);
        syn::visit::visit_item_fn(self, function);
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        self.add(&function.sig, &function.block);
        syn::visit::visit_impl_item_fn(self, function);
    }

    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if !is_test(module) {
            syn::visit::visit_item_mod(self, module);
        }
    }
}

fn type_names(items: &[syn::Item]) -> Vec<String> {
    let mut names = Vec::new();
    for item in items {
        match item {
            syn::Item::Struct(item) => names.push(item.ident.to_string()),
            syn::Item::Enum(item) => names.push(item.ident.to_string()),
            syn::Item::Trait(item) => names.push(item.ident.to_string()),
            syn::Item::Union(item) => names.push(item.ident.to_string()),
            syn::Item::Mod(module) if !is_test(module) => {
                names.extend(module.content.iter().flat_map(|(_, items)| type_names(items)));
            }
            _ => {}
        }
    }
    names
}

fn is_test(module: &syn::ItemMod) -> bool {
    let is_cfg_test = |attribute: &syn::Attribute| {
        attribute.path().is_ident("cfg") && attribute.parse_args::<syn::Path>().is_ok_and(|path| path.is_ident("test"))
    };
    module.ident == "tests" || module.attrs.iter().any(is_cfg_test)
}

fn parsed(file: &Path) -> syn::File {
    syn::parse_file(&fs::read_to_string(file).unwrap()).unwrap_or_else(|error| panic!("{}: {error}", shown(file)))
}

/// The Rust files of the program without its tests.
fn product_files() -> Vec<PathBuf> {
    let is_product = |file: &PathBuf| {
        let name = shown(file);
        let is_source = ["src/", "measurement/src/"].iter().any(|folder| name.starts_with(folder));
        is_source && name.ends_with(".rs") && !name.ends_with("/tests.rs") && !name.contains("/tests/")
    };
    files().into_iter().filter(is_product).collect()
}

/// Every file with text of ours: vendored libraries, other languages than English and copies (`docs/schema.sql` repeats
/// the migrations) are left out.
fn files() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for place in ["src", "measurement/src", "tests", "benches", "static", "docs", "migrations"] {
        collect(&root().join(place), &mut found);
    }
    found.extend(["README.md", "CHANGELOG.md", "CONTRIBUTING.md"].map(|name| root().join(name)));
    let released = fs::read_to_string(root().join("migrations/RELEASED")).unwrap();
    let is_ours = |file: &Path| {
        let name = file.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        !shown(file).starts_with("static/vendor")
            && !["de.js", "schema.sql"].contains(&name)
            && !released.lines().any(|line| line.ends_with(name))
    };
    found.retain(|file| is_ours(file));
    found.sort();
    found
}

fn collect(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        if path.ends_with("node_modules") {
            continue; // the browser tests' libraries
        }
        if path.is_dir() {
            collect(&path, found);
        } else if ["rs", "js", "mjs", "sql", "md"].contains(&extension) {
            found.push(path);
        }
    }
}

fn shown(file: &Path) -> String {
    file.strip_prefix(root()).unwrap_or(file).display().to_string()
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}
