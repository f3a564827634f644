//! Who imports whom: the graph of the files of a crate.
//!
//! An import is every path that a file names something of another file of its crate by, in a `use` or on the spot; `super::` is one
//! like any other, and so is what a parent uses of its children. No import is a `mod` line, nor the re-export of an own child
//! (`pub use child::X`, where the parent does not use X itself): who imports X from the parent imports the file that defines it.
//! What is compiled for tests alone does not count, nor do links of documentation.

use super::{tokens, without_tests};
use std::collections::{BTreeMap, BTreeSet};

/// A module: names from the root of the crate down.
type Module = Vec<String>;

/// A leaf of a `use`: `use a::{b as c}` is the path `a::b` under the name `c`.
#[derive(Clone, Debug)]
struct Leaf {
    path: Vec<String>,
    name: String,
    is_public: bool,
}

#[derive(Debug, Default)]
struct File {
    path: String,
    uses: Vec<Leaf>,
    /// Tokens outside of `use`.
    rest: Vec<String>,
    /// Names of items.
    defined: BTreeSet<String>,
}

/// The files of a crate.
#[derive(Debug)]
pub struct Crate {
    files: BTreeMap<Module, File>,
}

/// Files by their paths from the crate's `src`, or rooms by their names, each with those that it imports.
pub type Graph = BTreeMap<String, BTreeSet<String>>;

/// Sources of each crate, by the path of its folder: those below `src`, by their paths from there.
#[must_use]
pub fn crates(sources: &BTreeMap<String, String>) -> BTreeMap<String, Vec<(String, String)>> {
    let mut out: BTreeMap<String, Vec<(String, String)>> = BTreeMap::new();
    for (path, source) in sources {
        if let Some((folder, file)) = path.split_once("/src/") {
            out.entry(folder.into()).or_default().push((file.into(), source.clone()));
        }
    }
    out
}

impl Crate {
    /// Files by their paths from `src`, with their sources.
    #[must_use]
    pub fn new(sources: &[(String, String)]) -> Self {
        let (mut files, mut tests) = (BTreeMap::new(), Vec::new());
        // Without a library the program is the root.
        let has_library = sources.iter().any(|(path, _)| path == "lib.rs");
        for (path, source) in sources {
            let is_root = path == "main.rs" && !has_library;
            let module = if is_root { Module::new() } else { module_of(path) };
            let (code, for_tests) = without_tests(&tokens(source));
            tests.extend(for_tests.into_iter().map(|name| [module.clone(), vec![name]].concat()));
            let (uses, rest) = split_uses(&code);
            let defined = defined(&rest);
            files.insert(module, File { path: path.clone(), uses, rest, defined });
        }
        files.retain(|module, _| !tests.iter().any(|test: &Module| module.starts_with(test)));
        Self { files }
    }

    /// Every file with those that it imports.
    #[must_use]
    pub fn files(&self) -> Graph {
        self.files.iter().map(|(module, file)| (file.path.clone(), self.imports(module))).collect()
    }

    /// Every room (top-level module) with those that it imports.
    #[must_use]
    pub fn rooms(&self) -> Graph {
        let mut rooms = Graph::new();
        for (path, imports) in self.files() {
            let room = room_of(&path);
            let others = imports.iter().map(|other| room_of(other)).filter(|other| *other != room);
            rooms.entry(room.clone()).or_default().extend(others);
        }
        rooms
    }

    fn imports(&self, module: &Module) -> BTreeSet<String> {
        let (file, mut out) = (&self.files[module], BTreeSet::new());
        let mut add = |path: &[String]| {
            if let Some((other, _)) = self.resolve(module, path, &mut BTreeSet::new())
                && other != *module
            {
                out.insert(self.files[&other].path.clone());
            }
        };
        for leaf in &file.uses {
            let is_module = leaf.name != "*"
                && self.resolve(module, &leaf.path, &mut BTreeSet::new()).is_some_and(|(_, item)| item.is_none());
            let of_child = self.files.contains_key(&[&module[..], &leaf.path[..1]].concat());
            let is_re_export = leaf.is_public && of_child && !file.rest.contains(&leaf.name);
            // A module alone is nothing yet: what is named of it counts.
            if !is_module && !is_re_export {
                add(&leaf.path);
            }
        }
        for path in paths(&file.rest) {
            let known = ["crate", "super", "self"].contains(&path[0].as_str());
            if known || self.files.contains_key(&[&module[..], &path[..1]].concat()) {
                add(&path);
            } else if let Some(leaf) = file.uses.iter().find(|leaf| leaf.name == path[0]) {
                add(&[&leaf.path[..], &path[1..]].concat());
            }
        }
        out
    }

    /// The module whose file defines what `path` names as seen from `from`, and its name there; no name where `path` is a module.
    fn resolve(
        &self,
        from: &Module,
        path: &[String],
        seen: &mut BTreeSet<(Module, String)>,
    ) -> Option<(Module, Option<String>)> {
        match path[0].as_str() {
            "crate" => self.walk(&Module::new(), &path[1..], seen),
            "self" => self.walk(from, &path[1..], seen),
            "super" => {
                let up = path.iter().take_while(|name| *name == "super").count();
                self.walk(&from[..from.len().saturating_sub(up)].to_vec(), &path[up..], seen)
            }
            _ if self.files.contains_key(&[&from[..], &path[..1]].concat()) => self.walk(from, path, seen),
            first => {
                let leaf = self.files.get(from)?.uses.iter().find(|leaf| leaf.name == *first && leaf.path != path)?;
                let again = !seen.insert((from.clone(), first.to_string()));
                if again { None } else { self.resolve(from, &[&leaf.path[..], &path[1..]].concat(), seen) }
            }
        }
    }

    fn walk(
        &self,
        module: &Module,
        path: &[String],
        seen: &mut BTreeSet<(Module, String)>,
    ) -> Option<(Module, Option<String>)> {
        let (mut module, mut path) = (module.clone(), path);
        while let Some(first) = path.first() {
            let below = [&module[..], std::slice::from_ref(first)].concat();
            if !self.files.contains_key(&below) {
                break;
            }
            (module, path) = (below, &path[1..]);
        }
        let Some(item) = path.first() else { return Some((module, None)) };
        let file = self.files.get(&module)?;
        if let Some(leaf) = file.uses.iter().find(|leaf| leaf.name == *item && item != "*") {
            let again = !seen.insert((module.clone(), item.clone()));
            return if again { None } else { self.resolve(&module, &[&leaf.path[..], &path[1..]].concat(), seen) };
        }
        if !file.defined.contains(item) {
            let globs = file.uses.iter().filter(|leaf| leaf.name == "*");
            for glob in globs {
                let of = &glob.path[..glob.path.len() - 1];
                if let Some((other, None)) = self.resolve(&module, of, seen)
                    && self.files.get(&other).is_some_and(|file| file.defined.contains(item))
                {
                    return Some((other, Some(item.clone())));
                }
            }
        }
        Some((module, Some(item.clone())))
    }
}

/// Names of the items of a file.
fn defined(tokens: &[String]) -> BTreeSet<String> {
    let words = ["struct", "enum", "trait", "fn", "const", "static", "type", "union", "mod"];
    let items = tokens.windows(2).filter(|pair| words.contains(&pair[0].as_str()));
    items.map(|pair| pair[1].clone()).collect()
}

fn module_of(path: &str) -> Module {
    let mut module: Module = path.trim_end_matches(".rs").split('/').map(String::from).collect();
    if module.last().is_some_and(|last| last == "mod") || module == ["lib"] {
        module.pop();
    }
    module
}

/// `lib` for the root of the crate.
fn room_of(path: &str) -> String {
    module_of(path).first().map_or_else(|| "lib".into(), Clone::clone)
}

/// The leaves of all `use` lines, and the other tokens.
fn split_uses(tokens: &[String]) -> (Vec<Leaf>, Vec<String>) {
    let (mut uses, mut rest, mut i) = (Vec::new(), Vec::<String>::new(), 0);
    while i < tokens.len() {
        let is_use = tokens[i] == "use" && tokens.get(i + 1).is_none_or(|next| next != "<");
        if !is_use {
            rest.push(tokens[i].clone());
            i += 1;
            continue;
        }
        // `pub use`, `pub(crate) use`.
        let is_public = rest.last().is_some_and(|t| t == "pub" || t == ")");
        let end = (i..tokens.len()).find(|&k| tokens[k] == ";").unwrap_or(tokens.len());
        leaves(&tokens[i + 1..end], &[], is_public, &mut uses);
        i = end + 1;
    }
    (uses, rest)
}

fn leaves(tree: &[String], above: &[String], is_public: bool, out: &mut Vec<Leaf>) {
    let names = |part: &[String]| part.iter().filter(|t| *t != "::").cloned().collect::<Vec<_>>();
    if let Some(open) = tree.iter().position(|t| t == "{") {
        let above = [above, &names(&tree[..open])[..]].concat();
        let (mut depth, mut start) = (0, open + 1);
        for (k, token) in tree.iter().enumerate().skip(open + 1) {
            match token.as_str() {
                "{" => depth += 1,
                "}" if depth > 0 => depth -= 1,
                "," | "}" if depth == 0 => {
                    leaves(&tree[start..k], &above, is_public, out);
                    start = k + 1;
                }
                _ => {}
            }
        }
        return;
    }
    let (path, renamed) = match tree.iter().position(|t| t == "as") {
        Some(at) => (&tree[..at], tree.get(at + 1)),
        None => (tree, None),
    };
    let mut path = [above, &names(path)[..]].concat();
    if path.last().is_some_and(|last| last == "self") && path.len() > 1 {
        path.pop();
    }
    if let Some(last) = path.last() {
        let name = renamed.unwrap_or(last).clone();
        out.push(Leaf { path, name, is_public });
    }
}

/// Paths of two names at least: `a::b::c`.
fn paths(tokens: &[String]) -> Vec<Vec<String>> {
    let is_name = |t: &String| t.starts_with(|c: char| c.is_alphabetic() || c == '_');
    let (mut out, mut i) = (Vec::new(), 0);
    while i < tokens.len() {
        let mut path = Vec::new();
        // `pub(in crate::a)` says who sees a thing, not what is imported.
        let is_visibility = i > 1 && tokens[i - 1] == "in" && tokens[i - 2] == "(";
        if is_name(&tokens[i]) && !is_visibility && (i == 0 || tokens[i - 1] != "::") {
            path.push(tokens[i].clone());
            while tokens.get(i + 1).is_some_and(|t| t == "::") && tokens.get(i + 2).is_some_and(is_name) {
                path.push(tokens[i + 2].clone());
                i += 2;
            }
        }
        if path.len() > 1 {
            out.push(path);
        }
        i += 1;
    }
    out
}

/// The circles of a graph: sets of nodes of which each leads to each other, two at least, in order.
#[must_use]
pub fn circles(graph: &Graph) -> Vec<BTreeSet<String>> {
    let reach = |from: &str| {
        let (mut found, mut open) = (BTreeSet::new(), vec![from.to_string()]);
        while let Some(node) = open.pop() {
            for next in graph.get(&node).into_iter().flatten() {
                if found.insert(next.clone()) {
                    open.push(next.clone());
                }
            }
        }
        found
    };
    let reached: BTreeMap<&String, BTreeSet<String>> = graph.keys().map(|node| (node, reach(node))).collect();
    let mut out = BTreeSet::new();
    for (node, far) in &reached {
        if far.contains(*node) {
            let circle = far.iter().filter(|other| reached.get(other).is_some_and(|back| back.contains(*node)));
            out.insert(circle.cloned().collect::<BTreeSet<String>>());
        }
    }
    out.into_iter().filter(|circle| circle.len() > 1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(files: &[(&str, &str)]) -> Crate {
        Crate::new(&files.iter().map(|(path, source)| ((*path).into(), (*source).into())).collect::<Vec<_>>())
    }

    fn names(names: &[&str]) -> BTreeSet<String> {
        names.iter().map(|name| (*name).into()).collect()
    }

    #[test]
    fn a_name_goes_to_the_file_that_defines_it() {
        let house = graph(&[
            ("lib.rs", "pub mod a; pub mod b; mod c; pub use c::Deep;"),
            ("a.rs", "use crate::b::{self, Inner as I, deep::Other}; fn f() { b::inner::g('{'); crate::Deep::new(); }"),
            ("b/mod.rs", "mod inner; pub mod deep; pub use inner::Inner;"),
            ("b/inner.rs", "use super::deep::Other; pub struct Inner; pub fn g() {} // crate::a::f()"),
            (
                "b/deep.rs",
                "pub struct Other; #[cfg(test)] mod tests { use crate::a::f; } fn h() -> &'static str { \"crate::a\" }",
            ),
            ("c.rs", "pub struct Deep;"),
        ]);
        let files = house.files();
        assert_eq!(files["a.rs"], names(&["b/inner.rs", "b/deep.rs", "c.rs"]));
        assert_eq!(files["b/mod.rs"], names(&[]));
        assert_eq!(files["b/inner.rs"], names(&["b/deep.rs"]));
        assert_eq!(files["b/deep.rs"], names(&[]));
        assert_eq!(house.rooms()["a"], names(&["b", "c"]));
        assert!(circles(&files).is_empty() && circles(&house.rooms()).is_empty());
    }

    #[test]
    fn circles_are_found_and_super_is_an_import() {
        let house = graph(&[
            ("lib.rs", "mod a; mod b;"),
            ("a/mod.rs", "mod x; mod y; pub struct A; fn f() { x::f(); y::f(); }"),
            ("a/x.rs", "use super::A; pub fn f() {}"),
            ("a/y.rs", "use super::A; pub fn f() { let _ = crate::b::B; }"),
            ("b.rs", "pub use crate::a::A; pub struct B;"),
        ]);
        assert_eq!(circles(&house.files()), [names(&["a/mod.rs", "a/x.rs", "a/y.rs", "b.rs"])]);
        assert_eq!(circles(&house.rooms()), [names(&["a", "b"])]);
    }

    #[test]
    fn files_for_tests_do_not_count() {
        let house = graph(&[
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "#[cfg(test)] #[path = \"a_tests.rs\"] mod tests; pub struct A;"),
            ("a/tests.rs", "use crate::b::B;"),
            ("b.rs", "use crate::a::A; pub struct B; #[cfg(test)] use crate::c::{D, E}; struct F;"),
        ]);
        assert!(!house.files().contains_key("a/tests.rs"));
        assert!(circles(&house.files()).is_empty());
    }
}
