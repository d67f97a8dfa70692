//! A piece of a page that is well formed and escaped because of how it is made: names come from the program, text and
//! values from anywhere.

use std::fmt::Write;

/// Markup of HTML or SVG.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Node(String);

impl Node {
    /// The markup.
    pub fn markup(&self) -> &str {
        &self.0
    }
}

/// Names and values of an element.
pub type Attributes<'a> = &'a [(&'static str, &'a str)];

/// An element with what is inside it.
pub fn element(name: &'static str, attributes: Attributes, inside: impl IntoIterator<Item = Node>) -> Node {
    let mut markup = format!("<{name}");
    for (attribute, value) in attributes {
        let _ = write!(markup, " {attribute}=\"{}\"", escaped(value)); // writing to a string cannot fail
    }
    markup.push('>');
    inside.into_iter().for_each(|node| markup.push_str(&node.0));
    let _ = write!(markup, "</{name}>");
    Node(markup)
}

/// An element that cannot hold anything, such as `meta`.
pub fn empty(name: &'static str, attributes: Attributes) -> Node {
    let Node(whole) = element(name, attributes, []);
    Node(whole.trim_end_matches(&format!("</{name}>")).to_owned())
}

/// Text.
pub fn text(text: impl AsRef<str>) -> Node {
    Node(escaped(text.as_ref()))
}

/// A style sheet that was written with the program: its text stands in the page as it is.
pub fn style(sheets: &[&'static str]) -> Node {
    Node(format!("<style>\n{}</style>", sheets.concat()))
}

/// Text that neither ends an element nor an attribute, in whichever quotes. Control characters, which neither HTML nor
/// XML can hold, become the sign for something unreadable.
fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\t' | '\n' | '\r' => safe.push(' '),
            c if c.is_control() => safe.push('\u{fffd}'),
            c => safe.push(c),
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOSTILE: &str = "</svg><script>alert('\"')</script>&amp;\0";

    #[test]
    fn hostile_text_stays_text_inside_and_in_attributes() {
        let node = element("g", &[("aria-label", HOSTILE)], [text(HOSTILE)]);
        let inert = "&lt;/svg&gt;&lt;script&gt;alert(&#39;&quot;&#39;)&lt;/script&gt;&amp;amp;\u{fffd}";
        assert_eq!(node.markup(), format!("<g aria-label=\"{inert}\">{inert}</g>"));
    }

    #[test]
    fn an_empty_element_is_not_closed() {
        assert_eq!(empty("meta", &[("charset", "utf-8")]).markup(), "<meta charset=\"utf-8\">");
    }
}
