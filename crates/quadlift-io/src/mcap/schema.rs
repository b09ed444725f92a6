//! Definitions of ROS 2 messages: text as in `.msg` files (`ros2msg`) or IDL (`ros2idl`).
//!
//! Messages are decoded by the definition in the log, so that other versions of a type are read as they were written.

use std::collections::BTreeMap;
use std::sync::Arc;

/// A type whose values are not divided further.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Primitive {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
    Text,
    WideText,
}

/// The type of a field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Kind {
    Primitive(Primitive),
    /// Another message, by its index.
    Message(usize),
}

/// How many values a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Count {
    One,
    /// So many.
    Array(usize),
    /// As many as the message says.
    Sequence,
}

/// A field of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Field {
    pub name: Arc<str>,
    pub kind: Kind,
    pub count: Count,
}

/// A type of messages with those that it consists of; the first one is the type itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Definitions {
    pub messages: Vec<Vec<Field>>,
}

/// A field whose type is still a name.
struct RawField {
    kind: String,
    name: String,
    count: Count,
}

/// A name of a type with one slash: `std_msgs/Header`.
fn short_name(name: &str) -> String {
    name.replace("/msg/", "/").replace("::", "/").replace("/msg/", "/")
}

/// The definition of a type in the text of its schema.
///
/// # Errors
/// A text that says what was found and what was expected.
pub(super) fn parse_ros2msg(name: &str, text: &str) -> Result<Definitions, String> {
    let name = short_name(name);
    let mut raw: BTreeMap<String, Vec<RawField>> = BTreeMap::new();
    let mut current = name.clone();
    raw.insert(current.clone(), Vec::new());
    for (index, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() || line.len() >= 3 && line.bytes().all(|byte| byte == b'=') {
            continue;
        }
        if let Some(name) = line.strip_prefix("MSG:") {
            current = short_name(name.trim());
            raw.insert(current.clone(), Vec::new());
            continue;
        }
        let error = || format!("line {} of the schema: found \"{line}\"; expected a type and a name", index + 1);
        let (kind, rest) = line.split_once(char::is_whitespace).ok_or_else(error)?;
        let rest = rest.trim_start();
        let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        let (field, after) = rest.split_at(end);
        if field.is_empty() {
            return Err(error());
        }
        // A constant; a default has no sign before it.
        if after.trim_start().starts_with('=') {
            continue;
        }
        let (kind, count) = match kind.split_once('[') {
            None => (kind, Count::One),
            Some((kind, "]")) => (kind, Count::Sequence),
            Some((kind, bound)) if bound.starts_with("<=") => (kind, Count::Sequence),
            Some((kind, size)) => {
                let size = size.strip_suffix(']').and_then(|size| size.parse().ok()).ok_or_else(error)?;
                (kind, Count::Array(size))
            }
        };
        let package = current.split('/').next().unwrap_or_default();
        let kind = kind.split("<=").next().unwrap_or_default();
        let kind = match kind {
            "byte" | "char" => "uint8".to_owned(),
            _ if kind.contains('/') || primitive(kind).is_some() => short_name(kind),
            "Header" => "std_msgs/Header".to_owned(),
            _ => format!("{package}/{kind}"),
        };
        let field = RawField { kind, name: field.to_owned(), count };
        raw.entry(current.clone()).or_default().push(field);
    }
    resolve(&name, &raw)
}

fn primitive(name: &str) -> Option<Primitive> {
    Some(match name {
        "bool" | "boolean" => Primitive::Bool,
        "int8" => Primitive::I8,
        "uint8" | "octet" | "char" => Primitive::U8,
        "int16" | "short" => Primitive::I16,
        "uint16" | "unsigned short" => Primitive::U16,
        "int32" | "long" => Primitive::I32,
        "uint32" | "unsigned long" => Primitive::U32,
        "int64" | "long long" => Primitive::I64,
        "uint64" | "unsigned long long" => Primitive::U64,
        "float32" | "float" => Primitive::F32,
        "float64" | "double" => Primitive::F64,
        "string" => Primitive::Text,
        "wstring" => Primitive::WideText,
        _ => return None,
    })
}

/// Replaces names of types by indices.
fn resolve(name: &str, raw: &BTreeMap<String, Vec<RawField>>) -> Result<Definitions, String> {
    let mut indices = BTreeMap::from([(name.to_owned(), 0)]);
    let mut waiting = vec![name.to_owned()];
    let mut messages = Vec::new();
    while messages.len() < waiting.len() {
        let current = waiting[messages.len()].clone();
        // Known to every tool, and so left out by some.
        let known = match &*current {
            "builtin_interfaces/Time" | "builtin_interfaces/Duration" => {
                Some([("int32", "sec"), ("uint32", "nanosec")])
            }
            _ => None,
        };
        let builtin: Vec<RawField> = known
            .into_iter()
            .flatten()
            .map(|(kind, name)| RawField { kind: kind.to_owned(), name: name.to_owned(), count: Count::One })
            .collect();
        let Some(fields) = raw.get(&current).or(known.map(|_| &builtin)) else {
            return Err(format!("the schema does not define {current}"));
        };
        let mut resolved = Vec::with_capacity(fields.len());
        for field in fields {
            let kind = match primitive(&field.kind) {
                Some(primitive) => Kind::Primitive(primitive),
                None => Kind::Message(*indices.entry(field.kind.clone()).or_insert_with(|| {
                    waiting.push(field.kind.clone());
                    waiting.len() - 1
                })),
            };
            resolved.push(Field { name: field.name.as_str().into(), kind, count: field.count });
        }
        messages.push(resolved);
    }
    Ok(Definitions { messages })
}

/// The definition of a type in IDL, as far as ROS 2 makes it of messages: modules, structs, typedefs of arrays, constants and
/// annotations.
///
/// # Errors
/// A text that says what was found and what was expected.
pub(super) fn parse_ros2idl(name: &str, text: &str) -> Result<Definitions, String> {
    let mut parser = Idl { tokens: tokens(text), at: 0, raw: BTreeMap::new(), aliases: BTreeMap::new() };
    parser.definitions(&mut Vec::new())?;
    resolve(&short_name(name), &parser.raw)
}

/// The words, numbers, strings and signs of a text, without comments, annotations' strings and lines of the preprocessor.
fn tokens(text: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = text;
    loop {
        rest = rest.trim_start();
        let Some(first) = rest.chars().next() else { return tokens };
        let line = rest.find('\n').unwrap_or(rest.len());
        let word = |c: char| c.is_alphanumeric() || c == '_' || c == '.';
        let length = match first {
            // The line of `=` and the name of the file that follow each other where several files are in one schema.
            '#' | '=' if first == '#' || rest.starts_with("====") => {
                rest = &rest[line..];
                continue;
            }
            '/' if rest.starts_with("//") => {
                rest = &rest[line..];
                continue;
            }
            '/' if rest.starts_with("/*") => {
                rest = rest.split_once("*/").map_or("", |(_, rest)| rest);
                continue;
            }
            'I' if rest.starts_with("IDL:") => {
                rest = &rest[line..];
                continue;
            }
            '"' => {
                let mut is_escaped = false;
                let end = rest.char_indices().skip(1).find(|&(_, c)| {
                    let is_end = c == '"' && !is_escaped;
                    is_escaped = c == '\\' && !is_escaped;
                    is_end
                });
                end.map_or(rest.len(), |(end, _)| end + 1)
            }
            ':' if rest.starts_with("::") => 2,
            _ if word(first) => rest.find(|c| !word(c)).unwrap_or(rest.len()),
            _ => first.len_utf8(),
        };
        tokens.push(&rest[..length]);
        rest = &rest[length..];
    }
}

struct Idl<'a> {
    tokens: Vec<&'a str>,
    at: usize,
    raw: BTreeMap<String, Vec<RawField>>,
    aliases: BTreeMap<String, (String, Count)>,
}

impl<'a> Idl<'a> {
    fn peek(&self) -> &'a str {
        self.tokens.get(self.at).copied().unwrap_or_default()
    }

    fn next(&mut self) -> &'a str {
        let token = self.peek();
        self.at += 1;
        token
    }

    fn expect(&mut self, expected: &str) -> Result<(), String> {
        match self.next() {
            found if found == expected => Ok(()),
            "" => Err(format!("the IDL ends too early; expected \"{expected}\"")),
            found => Err(format!("found \"{found}\" in the IDL; expected \"{expected}\"")),
        }
    }

    /// Passes over what stands before a definition or a field.
    fn skip_annotations(&mut self) {
        while self.peek() == "@" {
            self.at += 2;
            while self.peek() == "::" {
                self.at += 2;
            }
            if self.peek() == "(" {
                let mut depth = 0;
                while self.at < self.tokens.len() {
                    match self.next() {
                        "(" => depth += 1,
                        ")" => depth -= 1,
                        _ => continue,
                    }
                    if depth == 0 {
                        break;
                    }
                }
            }
        }
    }

    fn definitions(&mut self, scope: &mut Vec<&'a str>) -> Result<(), String> {
        loop {
            self.skip_annotations();
            match self.next() {
                "" if scope.is_empty() => return Ok(()),
                "}" if !scope.is_empty() => return Ok(()),
                ";" => {}
                "module" => {
                    if scope.len() > 8 {
                        return Err("the modules of the IDL are too deep".to_owned());
                    }
                    scope.push(self.next());
                    self.expect("{")?;
                    self.definitions(scope)?;
                    scope.pop();
                }
                "const" => while !matches!(self.next(), ";" | "") {},
                "typedef" => {
                    let (kind, count) = self.kind(scope)?;
                    let name = self.next();
                    let count = self.dimension()?.unwrap_or(count);
                    self.aliases.insert(scoped(scope, name), (kind, count));
                    self.expect(";")?;
                }
                "struct" => {
                    let name = scoped(scope, self.next());
                    self.expect("{")?;
                    let mut fields = Vec::new();
                    loop {
                        self.skip_annotations();
                        if self.peek() == "}" {
                            self.at += 1;
                            break;
                        }
                        let (kind, count) = self.kind(scope)?;
                        let field = self.next().to_owned();
                        let count = self.dimension()?.unwrap_or(count);
                        self.expect(";")?;
                        fields.push(RawField { kind, name: field, count });
                    }
                    // ROS adds it where a message has no field.
                    fields.retain(|field| field.name != "structure_needs_at_least_one_member");
                    self.raw.insert(name, fields);
                }
                found => {
                    return Err(format!("found \"{found}\" in the IDL; expected a module, a struct or a constant"));
                }
            }
        }
    }

    /// A type, with the count of a sequence or of an alias.
    fn kind(&mut self, scope: &[&str]) -> Result<(String, Count), String> {
        let mut name = self.next().to_owned();
        match &*name {
            "sequence" => {
                self.expect("<")?;
                let (kind, count) = self.kind(scope)?;
                if count != Count::One {
                    return Err("a sequence of lists in the IDL is not supported".to_owned());
                }
                while !matches!(self.next(), ">" | "") {}
                return Ok((kind, Count::Sequence));
            }
            "string" | "wstring" => {
                if self.peek() == "<" {
                    while !matches!(self.next(), ">" | "") {}
                }
                return Ok((name, Count::One));
            }
            "unsigned" | "long" => {
                while matches!(self.peek(), "long" | "short" | "double") {
                    name = format!("{name} {}", self.next());
                }
                return Ok((name, Count::One));
            }
            _ => {}
        }
        while self.peek() == "::" {
            self.at += 1;
            name = format!("{name}::{}", self.next());
        }
        if primitive(&name).is_some() {
            return Ok((name, Count::One));
        }
        let name = if name.contains("::") { short_name(&name) } else { scoped(scope, &name) };
        Ok(self.aliases.get(&name).cloned().unwrap_or((name, Count::One)))
    }

    /// `[3]` after a name.
    fn dimension(&mut self) -> Result<Option<Count>, String> {
        if self.peek() != "[" {
            return Ok(None);
        }
        self.at += 1;
        let size = self.next();
        let size = size.parse().map_err(|_| format!("found \"{size}\" in the IDL; expected a size"))?;
        self.expect("]")?;
        Ok(Some(Count::Array(size)))
    }
}

/// A name in its package: the modules are the package and `msg`.
fn scoped(scope: &[&str], name: &str) -> String {
    short_name(&scope.iter().copied().chain([name]).collect::<Vec<_>>().join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_idl_of_one_type_are_the_same() {
        let text = "# A box.\nHeader header\nfloat64[3] size  # m\nstring<=10 id \"none\"\nuint8 A=1\nPoint[] corners\n\
            byte[<=4] flags\n================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\
            ================\nMSG: my_msgs/Point\nfloat32 x\n";
        let idl = "#include \"std_msgs/msg/Header.idl\"\nmodule my_msgs { module msg {\n\
            typedef double double__3[3];\nmodule Box_Constants { const uint8 A = 1; };\n\
            @verbatim (language=\"comment\", text=\"A box; \\\"(\")\nstruct Box { std_msgs::msg::Header header;\n\
            @unit (value=\"m\") double__3 size; string<10> id; sequence<my_msgs::msg::Point> corners;\n\
            sequence<octet, 4> flags; };};};\n================\nIDL: std_msgs/msg/Header\nmodule std_msgs { module msg {\n\
            struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };\n\
            module my_msgs { module msg { /* a\nb */ struct Point { float x; }; }; };";
        let from_text = parse_ros2msg("my_msgs/msg/Box", text).unwrap();
        assert_eq!(parse_ros2idl("my_msgs/msg/Box", idl).unwrap(), from_text);
        assert_eq!(from_text.messages.len(), 4);
        let counts: Vec<Count> = from_text.messages[0].iter().map(|field| field.count).collect();
        assert_eq!(counts, [Count::One, Count::Array(3), Count::One, Count::Sequence, Count::Sequence]);
    }

    #[test]
    fn what_is_missing_is_named() {
        let error = parse_ros2msg("a/msg/A", "B b\n").unwrap_err();
        assert_eq!(error, "the schema does not define a/B");
        let error = parse_ros2msg("a/msg/A", "\nfloat64\n").unwrap_err();
        assert_eq!(error, "line 2 of the schema: found \"float64\"; expected a type and a name");
        assert!(parse_ros2idl("a/msg/A", "module a { struct").unwrap_err().contains("ends too early"));
        assert_eq!(parse_ros2idl("a/msg/A", "").unwrap_err(), "the schema does not define a/A");
    }
}
