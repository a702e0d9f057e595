//! Finds the shaders of each entry file. A line `// variant NAME: DEFINE DEFINE (what it is for)` in an entry shader makes
//! one more shader of the same file with these preprocessor names defined.

use std::collections::BTreeMap;

/// Source and defines of one shader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    /// File name of the source.
    pub(crate) file: String,
    /// Defined preprocessor names.
    pub(crate) defines: Vec<String>,
    /// Line of the `variant` comment, from 1; 0 for the file itself.
    line: usize,
}

/// All shaders of these entry files, by name; `files` holds file name and text. Errors begin with file and line.
pub(crate) fn entries(files: &[(String, String)]) -> Result<BTreeMap<String, Entry>, String> {
    let plain =
        |(file, _): &(String, String)| (file.clone(), Entry { file: file.clone(), defines: Vec::new(), line: 0 });
    let mut all: BTreeMap<String, Entry> = files.iter().map(plain).collect();
    for (file, text) in files {
        for (i, line) in text.lines().enumerate() {
            let Some(rest) = line.trim_start().strip_prefix("// variant ") else { continue };
            let place = format!("glsl/{file}:{}", i + 1);
            let (name, defines) = parse(rest)
                .ok_or_else(|| format!("{place}: `// variant NAME: DEFINE DEFINE (what it is for)`, not `{line}`"))?;
            let kind = |name: &str| name.rsplit_once('.').map(|(_, kind)| kind.to_owned());
            if kind(name) != kind(file) {
                return Err(format!("{place}: variant {name} is of another stage than {file}"));
            }
            if let Some(define) = defines.iter().find(|define| !tests(text, define)) {
                return Err(format!("{place}: variant {name} defines {define}, which nothing in the file asks for"));
            }
            if let Some(other) = all.get(name) {
                let line = if other.line > 0 { format!(":{}", other.line) } else { String::new() };
                return Err(format!("{place}: variant {name} is there already: glsl/{}{line}", other.file));
            }
            all.insert(name.to_owned(), Entry { file: file.clone(), defines, line: i + 1 });
        }
    }
    Ok(all)
}

/// Parses name and defines from a variant line without its prefix.
fn parse(line: &str) -> Option<(&str, Vec<String>)> {
    let (name, rest) = line.split_once(':')?;
    let (defines, purpose) = rest.split_once('(')?;
    let name_is_plain = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '.');
    let defines: Vec<String> = defines.split_whitespace().map(str::to_owned).collect();
    let plain = |define: &String| define.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_');
    let whole = name_is_plain && !defines.is_empty() && defines.iter().all(plain) && purpose.trim_end().ends_with(')');
    whole.then_some((name, defines))
}

/// Whether a file has an `#ifdef` or `#ifndef` of a name.
fn tests(text: &str, define: &str) -> bool {
    text.lines().any(|line| {
        let mut words = line.split_whitespace();
        matches!(words.next(), Some("#ifdef" | "#ifndef")) && words.next() == Some(define)
    })
}
