//! Lists every path that product code names, in absolute form: `crate::…` for modules of our two crates, `tokio::…` for
//! others.
//!
//! Paths come from `use` trees, expressions, types, attributes and the tokens of macros. They are resolved as the
//! compiler does: by `crate`, `self` and `super`, by the `use` declarations of the module, by its child modules. A path
//! of one segment is a local name, or a name that a listed `use` brought in, so only `use` declarations and macros
//! contribute such paths. Code for tests only is left out.

use std::collections::{BTreeMap, BTreeSet};

use proc_macro2::{Delimiter, Spacing, TokenStream, TokenTree};
use syn::ext::IdentExt;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};

/// A path in product code.
#[derive(Clone, Debug, PartialEq)]
pub struct Mention {
    /// The file's path.
    pub file: String,
    /// The line of the path's first segment, or of the last one in a `use` tree.
    pub line: usize,
    /// The module that contains the code, without `crate`.
    pub module: Vec<String>,
    /// The absolute path. The name of a macro ends with `!`.
    pub path: Vec<String>,
}

/// Every path that the product code of `sources` names. A source is a file's path, and its text.
pub fn mentions(sources: &[(String, String)]) -> Vec<Mention> {
    let files: Vec<(&str, syn::File)> =
        sources.iter().map(|(file, text)| (file.as_str(), parsed(file, text))).collect();
    let test_only: BTreeSet<Vec<String>> =
        files.iter().flat_map(|(file, syntax)| test_modules(&module_of(file), &syntax.items)).collect();
    let mut collector = Collector::default();
    for (file, syntax) in &files {
        let module = module_of(file);
        let is_test = module.iter().any(|name| name == "tests")
            || (0..=module.len()).any(|length| test_only.contains(&module[..length]));
        if !is_test {
            (collector.file, collector.module) = ((*file).to_owned(), module);
            collector.enter();
            collector.visit_file(syntax);
        }
    }
    let scopes = collector.scopes;
    let resolved = |mention: Mention| Mention { path: scopes.absolute(&mention.module, &mention.path, 0), ..mention };
    collector.mentions.into_iter().map(resolved).collect()
}

/// `src/http/people/mod.rs` is `http::people`, `measurement/src/vision/frame.rs` is `vision::frame`.
pub fn module_of(file: &str) -> Vec<String> {
    let (_, inside) = file.split_once("src/").expect("a file of SOURCES");
    let names = inside.trim_end_matches(".rs").split('/').map(str::to_owned);
    names.filter(|name| name != "mod" && name != "lib").collect()
}

fn parsed(file: &str, text: &str) -> syn::File {
    syn::parse_file(text).unwrap_or_else(|error| panic!("{file}:{}: {error}", error.span().start().line))
}

/// The modules that are declared for tests only, with their full names.
fn test_modules(parent: &[String], items: &[syn::Item]) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for item in items {
        let syn::Item::Mod(module) = item else { continue };
        let name = [parent, &[module.ident.unraw().to_string()]].concat();
        let inner = module.content.as_ref().map(|(_, items)| test_modules(&name, items));
        found.extend(inner.unwrap_or_default());
        if is_for_tests(&module.attrs) {
            found.push(name);
        }
    }
    found
}

fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg") && attribute.parse_args::<syn::Path>().is_ok_and(|path| path.is_ident("test"))
    })
}

/// The names that a module can use without a path.
#[derive(Default)]
struct Scope {
    /// Names from `use` declarations, with the path as written.
    imports: BTreeMap<String, Vec<String>>,
    /// Paths of `use …::*`.
    globs: Vec<Vec<String>>,
}

/// The scope of each module of both crates. Their modules have different names, and `trocar` re-exports all of
/// `measurement`'s.
#[derive(Default)]
struct Scopes(BTreeMap<Vec<String>, Scope>);

impl Scopes {
    /// Imports may name imports; circles end at this depth.
    const MAX_DEPTH: usize = 8;

    fn absolute(&self, module: &[String], path: &[String], depth: usize) -> Vec<String> {
        let Some((first, rest)) = path.split_first() else { return Vec::new() };
        let inside = |module: &[String], rest: &[String]| [&["crate".to_owned()], module, rest].concat();
        match first.as_str() {
            "" => rest.to_vec(), // `::name` is always another crate
            "crate" | "trocar" => inside(&[], rest),
            "self" if rest.first().is_some_and(|next| next == "super") => self.absolute(module, rest, depth),
            "self" => inside(module, rest),
            "super" => {
                let supers = path.iter().take_while(|name| *name == "super").count();
                inside(&module[..module.len().saturating_sub(supers)], &path[supers..])
            }
            _ if depth == Self::MAX_DEPTH => path.to_vec(),
            name => self.absolute_by_scope(module, name, rest, depth).unwrap_or_else(|| match name {
                "measurement" => inside(&[], rest),
                _ => path.to_vec(),
            }),
        }
    }

    /// Resolves a path that begins with a name in scope. [`None`]: the name is another crate, or local.
    fn absolute_by_scope(&self, module: &[String], name: &str, rest: &[String], depth: usize) -> Option<Vec<String>> {
        let scope = self.0.get(module)?;
        let child = [module, &[name.to_owned()]].concat();
        if let Some(import) = scope.imports.get(name).filter(|import| import[0] != name) {
            return Some(self.absolute(module, &[import, rest].concat(), depth + 1));
        }
        if self.0.contains_key(&child) {
            return Some([&["crate".to_owned()], &child[..], rest].concat());
        }
        scope.globs.iter().find_map(|glob| {
            let glob = self.absolute(module, glob, depth + 1);
            let (root, target) = glob.split_first()?;
            let is_other = root == "crate" && target != module && depth < Self::MAX_DEPTH;
            is_other.then(|| self.absolute_by_scope(target, name, rest, depth + 1))?
        })
    }
}

/// Collects the paths as written, and the scopes that resolve them.
#[derive(Default)]
struct Collector {
    file: String,
    module: Vec<String>,
    scopes: Scopes,
    mentions: Vec<Mention>,
}

impl Collector {
    /// Makes the module known.
    fn enter(&mut self) -> &mut Scope {
        self.scopes.0.entry(self.module.clone()).or_default()
    }

    fn add(&mut self, line: usize, path: Vec<String>) {
        self.mentions.push(Mention { file: self.file.clone(), line, module: self.module.clone(), path });
    }

    fn add_use(&mut self, tree: &syn::UseTree, prefix: &[String]) {
        let joined = |name: &syn::Ident| [prefix, &[name.unraw().to_string()]].concat();
        let (name, path) = match tree {
            syn::UseTree::Path(tree) => return self.add_use(&tree.tree, &joined(&tree.ident)),
            syn::UseTree::Group(group) => return group.items.iter().for_each(|tree| self.add_use(tree, prefix)),
            syn::UseTree::Glob(glob) => {
                self.enter().globs.push(prefix.to_vec());
                return self.add(glob.star_token.spans[0].start().line, prefix.to_vec());
            }
            syn::UseTree::Name(tree) if tree.ident == "self" => (prefix.last().cloned(), prefix.to_vec()),
            syn::UseTree::Name(tree) => (Some(tree.ident.unraw().to_string()), joined(&tree.ident)),
            syn::UseTree::Rename(tree) if tree.ident == "self" => (Some(tree.rename.to_string()), prefix.to_vec()),
            syn::UseTree::Rename(tree) => (Some(tree.rename.to_string()), joined(&tree.ident)),
        };
        if let Some(name) = name.filter(|name| name != "_") {
            self.enter().imports.insert(name, path.clone());
        }
        self.add(tree.span().start().line, path);
    }

    /// Adds the paths among tokens: names joined by `::`, also with a group as the last part (`a::{b, c::d}`).
    fn add_tokens(&mut self, tokens: TokenStream, prefix: &[String]) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let mut rest = &tokens[..];
        while let [first, after_first @ ..] = rest {
            let (names, after) = leading_path(rest);
            let path = [prefix, &names].concat();
            rest = if names.is_empty() { after_first } else { after };
            match (first, after, after_colons(after)) {
                (TokenTree::Group(group), ..) => self.add_tokens(group.stream(), &[]),
                _ if names.is_empty() => {}
                (_, [TokenTree::Punct(mark), TokenTree::Group(_), ..], _) if mark.as_char() == '!' => {
                    self.add(first.span().start().line, macro_path(path));
                }
                (_, _, Some([TokenTree::Group(group), after_group @ ..])) if group.delimiter() == Delimiter::Brace => {
                    self.add_tokens(group.stream(), &path);
                    rest = after_group;
                }
                _ if path.len() > 1 => self.add(first.span().start().line, path),
                _ => {}
            }
        }
    }

    /// Paths in the strings of an attribute, such as `serde(with = "crate::time::text")`.
    fn add_strings(&mut self, tokens: TokenStream) {
        for token in tokens {
            match token {
                TokenTree::Group(group) => self.add_strings(group.stream()),
                TokenTree::Literal(literal) => {
                    let text = literal.to_string();
                    if let Ok(path) = syn::parse_str::<syn::Path>(text.trim_matches('"')) {
                        self.add_path(&path, literal.span().start().line);
                    }
                }
                _ => {}
            }
        }
    }

    fn add_path(&mut self, path: &syn::Path, line: usize) {
        if path.segments.len() > 1 {
            let root = path.leading_colon.map(|_| String::new());
            let names = path.segments.iter().map(|segment| segment.ident.unraw().to_string());
            self.add(line, root.into_iter().chain(names).collect());
        }
    }
}

/// The names at the front of the tokens that `::` joins, and the tokens after them.
fn leading_path(tokens: &[TokenTree]) -> (Vec<String>, &[TokenTree]) {
    let mut names = Vec::new();
    let mut rest = tokens;
    while let [TokenTree::Ident(name), after @ ..] = rest {
        names.push(name.unraw().to_string());
        rest = after;
        match after_colons(after) {
            Some(next @ [TokenTree::Ident(_), ..]) => rest = next,
            _ => break,
        }
    }
    (names, rest)
}

/// The tokens after `::`, if the tokens begin with it.
fn after_colons(tokens: &[TokenTree]) -> Option<&[TokenTree]> {
    let is_colon = |token: &TokenTree| matches!(token, TokenTree::Punct(mark) if mark.as_char() == ':');
    let [TokenTree::Punct(first), second, rest @ ..] = tokens else { return None };
    (first.as_char() == ':' && first.spacing() == Spacing::Joint && is_colon(second)).then_some(rest)
}

/// The path of a macro, marked as such.
fn macro_path(mut path: Vec<String>) -> Vec<String> {
    if let Some(name) = path.last_mut() {
        name.push('!');
    }
    path
}

/// The attributes of an item of any of these kinds.
macro_rules! attributes {
    ($items:ident, $item:expr, $($kind:ident),*) => {
        match $item {
            $(syn::$items::$kind(item) => &item.attrs,)*
            _ => &[][..],
        }
    };
}

impl<'ast> Visit<'ast> for Collector {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        let attributes: &[syn::Attribute] = attributes!(
            Item,
            item,
            Const,
            Enum,
            ExternCrate,
            Fn,
            ForeignMod,
            Impl,
            Macro,
            Mod,
            Static,
            Struct,
            Trait,
            Type,
            Union,
            Use
        );
        if !is_for_tests(attributes) {
            visit::visit_item(self, item);
        }
    }

    fn visit_impl_item(&mut self, item: &'ast syn::ImplItem) {
        let attributes: &[syn::Attribute] = attributes!(ImplItem, item, Const, Fn, Type, Macro);
        if !is_for_tests(attributes) {
            visit::visit_impl_item(self, item);
        }
    }

    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if module.ident != "tests" {
            self.module.push(module.ident.unraw().to_string());
            self.enter();
            visit::visit_item_mod(self, module);
            self.module.pop();
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        let root: &[String] = if item.leading_colon.is_some() { &[String::new()] } else { &[] };
        self.add_use(&item.tree, root);
    }

    fn visit_item_extern_crate(&mut self, item: &'ast syn::ItemExternCrate) {
        self.add(item.ident.span().start().line, vec![item.ident.unraw().to_string()]);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        self.add_path(path, path.span().start().line);
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, mac: &'ast syn::Macro) {
        let names = mac.path.segments.iter().map(|segment| segment.ident.unraw().to_string());
        self.add(mac.path.span().start().line, macro_path(names.collect()));
        self.add_tokens(mac.tokens.clone(), &[]);
    }

    fn visit_attribute(&mut self, attribute: &'ast syn::Attribute) {
        if let syn::Meta::List(list) = &attribute.meta {
            self.add_tokens(list.tokens.clone(), &[]);
            self.add_strings(list.tokens.clone());
        }
        visit::visit_attribute(self, attribute);
    }
}
