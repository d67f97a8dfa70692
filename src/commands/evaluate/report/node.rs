//! HTML and SVG markup that is always well formed and escaped: element and attribute names are constants of the
//! program, texts and attribute values are escaped.

use std::fmt::Write;

/// Markup of HTML or SVG.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Markup(String);

impl Markup {
    /// The markup.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Attribute names and values of an element.
pub type Attributes<'a> = &'a [(&'static str, &'a str)];

/// An element with its content.
pub fn element(name: &'static str, attributes: Attributes, inside: impl IntoIterator<Item = Markup>) -> Markup {
    let mut markup = format!("<{name}");
    for (attribute, value) in attributes {
        let _ = write!(markup, " {attribute}=\"{}\"", escaped(value)); // writing to a string cannot fail
    }
    markup.push('>');
    inside.into_iter().for_each(|node| markup.push_str(&node.0));
    let _ = write!(markup, "</{name}>");
    Markup(markup)
}

/// A void element, such as `meta`.
pub fn void_element(name: &'static str, attributes: Attributes) -> Markup {
    let Markup(whole) = element(name, attributes, []);
    Markup(whole.trim_end_matches(&format!("</{name}>")).to_owned())
}

/// Escaped text.
pub fn text(text: impl AsRef<str>) -> Markup {
    Markup(escaped(text.as_ref()))
}

/// A style sheet of the program, inserted unescaped.
pub fn style(sheets: &[&'static str]) -> Markup {
    Markup(format!("<style>\n{}</style>", sheets.concat()))
}

/// Escapes text so that it can end neither an element nor an attribute, with single or double quotes. Control
/// characters, which HTML and XML forbid, become U+FFFD.
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
        assert_eq!(node.as_str(), format!("<g aria-label=\"{inert}\">{inert}</g>"));
    }

    #[test]
    fn a_void_element_is_not_closed() {
        assert_eq!(void_element("meta", &[("charset", "utf-8")]).as_str(), "<meta charset=\"utf-8\">");
    }
}
