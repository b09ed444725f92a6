//! XML as a tree of elements with their places (feature `xml`).

use std::path::Path;

use crate::error::ReadError;
use crate::input::as_utf8;

/// Whether a file may have a document type (DOCTYPE), which may define entities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DocumentType {
    /// It may; the parser limits how deep and how often entities are expanded.
    Allowed,
    /// It is an error.
    Refused,
}

/// An XML file.
pub(super) struct Xml<'a> {
    path: &'a Path,
    text: &'a str,
    /// The outermost element.
    pub root: Element,
}

/// An element with its content.
pub(super) struct Element {
    /// Name, without its namespace.
    pub name: Box<str>,
    text: Box<str>,
    /// Where it begins, in bytes.
    start: usize,
    /// Names, without their namespaces, and values.
    attributes: Box<[(Box<str>, Box<str>)]>,
    elements: Vec<Element>,
}

impl Element {
    /// The text before the first element in it, without the white space around it.
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// The elements of this name in it.
    pub(super) fn children(&self, name: &str) -> impl Iterator<Item = &Self> {
        self.elements.iter().filter(move |child| &*child.name == name)
    }

    /// All elements in it.
    pub(super) fn all_children(&self) -> &[Self] {
        &self.elements
    }

    /// The value of an attribute, if present, without the white space around it.
    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| &**key == name).map(|(_, value)| value.trim())
    }
}

impl<'a> Xml<'a> {
    /// Reads a file; `expected` describes its content for messages.
    #[cfg(feature = "xml")]
    pub(super) fn parse(
        path: &'a Path,
        bytes: &'a [u8],
        expected: &str,
        document_type: DocumentType,
    ) -> Result<Self, ReadError> {
        let text = as_utf8(path, bytes)?;
        check_attributes(text).map_err(|line| {
            ReadError::new(path, format!("an element has more than {MAX_ATTRIBUTES} attributes; expected {expected}"))
                .at(line, 0)
        })?;
        let allow_dtd = document_type == DocumentType::Allowed;
        let options = roxmltree::ParsingOptions { allow_dtd, nodes_limit: 50_000_000, ..Default::default() };
        let document = roxmltree::Document::parse_with_options(text, options).map_err(|error| {
            if matches!(error, roxmltree::Error::DtdDetected) {
                let problem = "the file has a document type (<!DOCTYPE>), which may define entities";
                return ReadError::new(path, format!("{problem}; expected {expected}"));
            }
            let place = error.pos();
            ReadError::new(path, format!("this is not valid XML: {error}")).at(place.row as usize, place.col as usize)
        })?;
        let mut xml = Self { path, text, root: Element::of(document.root_element()) };
        xml.root.elements = xml.elements(document.root_element(), 1)?;
        Ok(xml)
    }

    /// The elements in a node that is so many levels deep.
    #[cfg(feature = "xml")]
    fn elements(&self, node: roxmltree::Node, depth: usize) -> Result<Vec<Element>, ReadError> {
        let element = |child: roxmltree::Node| {
            let element = Element::of(child);
            if depth == DEEPEST {
                return Err(self.error(&element, format!("elements are nested more than {DEEPEST} levels deep")));
            }
            Ok(Element { elements: self.elements(child, depth + 1)?, ..element })
        };
        node.children().filter(roxmltree::Node::is_element).map(element).collect()
    }

    /// Says that XML is not read.
    #[cfg(not(feature = "xml"))]
    pub(super) fn parse(
        path: &'a Path,
        bytes: &'a [u8],
        expected: &str,
        document_type: DocumentType,
    ) -> Result<Self, ReadError> {
        let _ = (as_utf8(path, bytes)?, expected, document_type);
        Err(ReadError::left_out(path, "XML files", "xml"))
    }

    /// A problem with an element.
    pub(super) fn error(&self, element: &Element, problem: impl Into<String>) -> ReadError {
        let before = &self.text[..element.start];
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let (line, column) = (1 + before.matches('\n').count(), 1 + before[line_start..].chars().count());
        ReadError::new(self.path, problem).at(line, column)
    }

    /// The first element of this name in another one.
    pub(super) fn child<'e>(&self, element: &'e Element, name: &str) -> Result<&'e Element, ReadError> {
        let found = element.children(name).next();
        found.ok_or_else(|| self.error(element, format!("there is no <{name}> in <{}>", element.name)))
    }

    /// The text in the first element of this name in another one, and that element.
    pub(super) fn text<'e>(&self, element: &'e Element, name: &str) -> Result<(&'e str, &'e Element), ReadError> {
        let child = self.child(element, name)?;
        Ok((&child.text, child))
    }

    /// The number in the first element of this name in another one.
    pub(super) fn number(&self, element: &Element, name: &str) -> Result<f64, ReadError> {
        let (text, child) = self.text(element, name)?;
        let number = text.parse::<f64>().ok().filter(|x| x.is_finite());
        number.ok_or_else(|| self.error(child, format!("<{name}> is \"{text}\"; expected a number")))
    }

    /// An attribute that must be there.
    pub(super) fn attribute<'e>(&self, element: &'e Element, name: &str) -> Result<&'e str, ReadError> {
        let found = element.attribute(name);
        found.ok_or_else(|| self.error(element, format!("there is no attribute \"{name}\" in <{}>", element.name)))
    }

    /// An attribute that must be a number.
    pub(super) fn attribute_number(&self, element: &Element, name: &str) -> Result<f64, ReadError> {
        self.parsed(element, name, "a number", |text| text.parse().ok().filter(|x: &f64| x.is_finite()))
    }

    /// An attribute that must be a whole number from 0.
    pub(super) fn attribute_whole(&self, element: &Element, name: &str) -> Result<u32, ReadError> {
        self.parsed(element, name, "a whole number from 0", |text| text.parse().ok())
    }

    fn parsed<T>(
        &self,
        element: &Element,
        name: &str,
        expected: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Result<T, ReadError> {
        let text = self.attribute(element, name)?;
        let shown: String = text.chars().take(40).collect();
        parse(text)
            .ok_or_else(|| self.error(element, format!("the attribute {name} is \"{shown}\"; expected {expected}")))
    }
}

#[cfg(feature = "xml")]
impl Element {
    /// A node, without the elements in it.
    fn of(node: roxmltree::Node) -> Self {
        Self {
            name: node.tag_name().name().into(),
            text: node.text().unwrap_or_default().trim().into(),
            start: node.range().start,
            attributes: node.attributes().map(|each| (each.name().into(), each.value().into())).collect(),
            elements: Vec::new(),
        }
    }
}

/// Most levels of elements: they are visited recursively. KITTI's files have six.
#[cfg(feature = "xml")]
const DEEPEST: usize = 100;

/// Maximum number of attributes of an element: the parser compares each with all others. KITTI files have at most four.
#[cfg(feature = "xml")]
const MAX_ATTRIBUTES: usize = 1000;

/// Refuses elements with many attributes; the error is the line of the first.
#[cfg(feature = "xml")]
fn check_attributes(text: &str) -> Result<(), usize> {
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        rest = &rest[start..];
        let skipped = [("<!--", "-->"), ("<![CDATA[", "]]>")].into_iter().find(|(begin, _)| rest.starts_with(begin));
        if let Some((_, end)) = skipped {
            let Some(end) = rest.find(end) else { return Ok(()) };
            rest = &rest[end..];
            continue;
        }
        // Texts in quotes may hold a '>'; those of a DOCTYPE may hold elements.
        let is_declaration = rest.starts_with("<!");
        let (mut quote, mut attributes, mut end) = (None, 0, rest.len());
        for (at, byte) in rest.bytes().enumerate().skip(1) {
            match (quote, byte) {
                (None, b'>') => {
                    end = at;
                    break;
                }
                (None, b'"' | b'\'') => quote = Some(byte),
                (Some(open), byte) if open == byte => quote = None,
                (None, b'=') => attributes += 1,
                (Some(_), b'=') if is_declaration => attributes += 1,
                _ => {}
            }
        }
        if attributes > MAX_ATTRIBUTES {
            return Err(1 + text[..text.len() - rest.len()].matches('\n').count());
        }
        rest = &rest[end..];
    }
    Ok(())
}
