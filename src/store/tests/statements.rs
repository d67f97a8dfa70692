//! Every statement is a named constant, and SQLite accepts it: a wrong name in SQL is found here, not by a request.

use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{TokenStream, TokenTree};
use sqlx::{AssertSqlSafe, Executor, SqlSafeStr};
use syn::visit::{self, Visit};

use crate::store::testing::TestCentre;

const VERBS: [&str; 7] = ["SELECT", "INSERT", "UPDATE", "DELETE", "WITH", "PRAGMA", "VACUUM"];

/// The statements of one source file.
#[derive(Default)]
struct FileStatements {
    file: String,
    /// The constant that is being read.
    constant: Option<String>,
    /// Names and texts of the constants.
    named: Vec<(String, String)>,
    /// Places of statements that are no constants.
    unnamed: Vec<String>,
}

impl FileStatements {
    fn of(file: &str, source: &str) -> Self {
        let mut statements = Self { file: file.to_owned(), ..Self::default() };
        statements.visit_file(&syn::parse_file(source).unwrap());
        statements
    }

    fn refuse(&mut self, at: proc_macro2::Span, what: &str) {
        self.unnamed.push(format!("{}:{}: {what}", self.file, at.start().line));
    }

    /// Refuses statements that a macro takes or composes.
    fn refuse_in(&mut self, tokens: TokenStream) {
        for token in tokens {
            match token {
                TokenTree::Group(group) => self.refuse_in(group.stream()),
                TokenTree::Literal(literal) => match syn::parse2::<syn::LitStr>(TokenTree::from(literal).into()) {
                    Ok(text) if is_statement(&text.value()) => self.refuse(text.span(), "a statement in a macro"),
                    _ => {}
                },
                TokenTree::Ident(_) | TokenTree::Punct(_) => {}
            }
        }
    }
}

impl<'ast> Visit<'ast> for FileStatements {
    fn visit_item_const(&mut self, item: &'ast syn::ItemConst) {
        self.constant = Some(item.ident.to_string());
        visit::visit_item_const(self, item);
        self.constant = None;
    }

    fn visit_lit_str(&mut self, literal: &'ast syn::LitStr) {
        let text = literal.value();
        match &self.constant {
            _ if !is_statement(&text) => {}
            Some(name) => self.named.push((name.clone(), text)),
            None => self.refuse(literal.span(), "a statement that is no constant"),
        }
    }

    fn visit_expr_call(&mut self, call: &'ast syn::ExprCall) {
        let is_path = matches!(call.args.first(), Some(syn::Expr::Path(_)));
        if let syn::Expr::Path(called) = &*call.func
            && called.path.segments.last().is_some_and(|last| last.ident.to_string().starts_with("query"))
            && called.path.segments.first().is_some_and(|first| first.ident == "sqlx")
            && !is_path
        {
            self.refuse(called.path.segments[0].ident.span(), "a query of something else than a constant");
        }
        visit::visit_expr_call(self, call);
    }

    fn visit_macro(&mut self, called: &'ast syn::Macro) {
        self.refuse_in(called.tokens.clone());
    }
}

fn is_statement(text: &str) -> bool {
    let verb = text.split_whitespace().next().unwrap_or_default();
    VERBS.contains(&verb)
}

/// The source files below a folder, without tests.
fn source_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.file_name().and_then(|name| name.to_str()).unwrap() {
            "tests" | "testing.rs" => {}
            _ if path.is_dir() => found.extend(source_files(&path)),
            _ => found.push(path),
        }
    }
    found.sort();
    found
}

fn statements() -> Vec<FileStatements> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/store");
    let name = |file: &Path| file.strip_prefix(&folder).unwrap().display().to_string();
    let of = |file: &PathBuf| FileStatements::of(&name(file), &fs::read_to_string(file).unwrap());
    source_files(&folder).iter().map(of).collect()
}

#[test]
fn every_statement_is_a_named_constant() {
    let unnamed: Vec<String> = statements().into_iter().flat_map(|file| file.unnamed).collect();
    assert!(unnamed.is_empty(), "name these statements with constants:\n{}", unnamed.join("\n"));
}

#[tokio::test]
async fn the_database_accepts_every_statement() {
    let centre = TestCentre::new().await;
    let mut accepted = 0;
    for FileStatements { file, named, .. } in statements() {
        for (name, text) in named {
            let prepared = centre.store.readers().prepare(AssertSqlSafe(text).into_sql_str()).await;
            assert!(prepared.is_ok(), "{file}: {name}: {}", prepared.err().unwrap());
            accepted += 1;
        }
    }
    assert!(accepted >= 150, "only {accepted} statements were found");
}

#[test]
fn every_statement_on_trainees_in_a_scope_leaves_out_hidden_ones() {
    let mut checked = 0;
    for FileStatements { file, named, .. } in statements() {
        for (name, text) in named.iter().filter(|(_, text)| text.contains("FROM visible_trainee")) {
            let may_see_them = file == "pending_erasures.rs";
            assert!(may_see_them || text.contains("FROM hidden_trainee"), "{file}: {name}: see `visibility.rs`");
            checked += 1;
        }
    }
    assert!(checked >= 20, "only {checked} statements were found");
}

/// Statements that read sessions in a scope, except those that only staff may run or that read counted sessions only.
#[test]
fn every_statement_on_sessions_in_a_scope_leaves_out_sealed_ones() {
    let of_staff_or_counted = [
        "SELECT_BLIND_RATINGS",
        "SELECT_BLIND_SHEETS",
        "SELECT_RATED_RESULTS",
        "SELECT_FIRST_STEPS",
        "SELECT_VALUES",
        "SELECT_MOVES",      // after the session itself was read in the scope
        "SELECT_CUTS",       // likewise; an attempt is never cut
        "SELECT_DISMISSALS", // of staff, with numbers of sessions only
        "SELECT_PENDING",    // of administrators, with numbers of sessions only
    ];
    let mut checked = 0;
    for FileStatements { file, named, .. } in statements() {
        for (name, text) in &named {
            let reads =
                ["session", "session_record", "practised_session", "assessed_session", "current_result", "result"];
            let reads_sessions = reads.iter().any(|table| {
                [" ", "\n", ","].iter().any(|end| {
                    text.contains(&format!("FROM {table}{end}")) || text.contains(&format!("JOIN {table}{end}"))
                })
            });
            let is_scoped = text.contains("FROM visible_trainee") || text.contains("FROM visible_job");
            if !is_scoped || !reads_sessions || of_staff_or_counted.contains(&name.as_str()) {
                continue;
            }
            let is_sealed = text.contains("FROM sealed_session") || text.contains("FROM visible_job");
            assert!(is_sealed, "{file}: {name}: see `exams/seal.rs`");
            checked += 1;
        }
    }
    assert!(checked >= 20, "only {checked} statements were found");
}

#[test]
fn statements_that_are_no_constants_are_found() {
    let named = FileStatements::of("x.rs", "const A: &str = \"\n SELECT 1\"; fn f() { sqlx::query(A); }");
    assert_eq!((named.named.len(), named.unnamed), (1, vec![]));
    for code in [
        "sqlx::query(\"SELECT 1\")",
        "let sql = \" DELETE FROM task\"",
        "sqlx::query_as::<_, Row>(AssertSqlSafe(text))",
        "let sql = format!(\"SELECT {column} FROM task\")",
        "sqlx::query_scalar(concat!(A, B))",
    ] {
        let source = format!("fn f() {{ {code}; }}");
        assert_ne!(FileStatements::of("x.rs", &source).unnamed, Vec::<String>::new(), "{code}");
    }
}
