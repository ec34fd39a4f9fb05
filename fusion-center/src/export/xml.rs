//! Elements, attributes and text of XML, escaped by a library.

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesEnd, BytesStart, BytesText, Event};

use super::ExportError;

type Attributes<'a> = &'a [(&'a str, &'a str)];

/// A document that grows; the caller closes what it opens.
pub(super) struct Xml(Writer<Vec<u8>>);

impl Xml {
    /// Begins a document, over lines with this indentation or, with none, all on one line.
    pub(super) fn new(indent: Option<usize>) -> Result<Self, ExportError> {
        let mut writer = match indent {
            Some(size) => Writer::new_with_indent(Vec::new(), b' ', size),
            None => Writer::new(Vec::new()),
        };
        writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
        Ok(Self(writer))
    }

    pub(super) fn open(
        &mut self,
        name: &str,
        attributes: Attributes<'_>,
    ) -> Result<(), ExportError> {
        Ok(self.0.write_event(Event::Start(start(name, attributes)))?)
    }

    pub(super) fn close(&mut self, name: &str) -> Result<(), ExportError> {
        Ok(self.0.write_event(Event::End(BytesEnd::new(name)))?)
    }

    pub(super) fn empty(
        &mut self,
        name: &str,
        attributes: Attributes<'_>,
    ) -> Result<(), ExportError> {
        Ok(self.0.write_event(Event::Empty(start(name, attributes)))?)
    }

    pub(super) fn text(&mut self, name: &str, text: &str) -> Result<(), ExportError> {
        self.open(name, &[])?;
        self.0.write_event(Event::Text(BytesText::new(&allowed(text))))?;
        self.close(name)
    }

    pub(super) fn finish(self) -> String {
        String::from_utf8_lossy(&self.0.into_inner()).into_owned()
    }
}

fn start<'a>(name: &'a str, attributes: Attributes<'_>) -> BytesStart<'a> {
    let mut element = BytesStart::new(name);
    for (key, value) in attributes {
        element.push_attribute((*key, allowed(value).as_str()));
    }
    element
}

/// XML has no way at all to say most control characters.
fn allowed(text: &str) -> String {
    let is_allowed = |c: char| {
        matches!(c, '\t' | '\n' | '\r') || (c >= ' ' && c != '\u{FFFE}' && c != '\u{FFFF}')
    };
    text.chars().map(|c| if is_allowed(c) { c } else { '\u{FFFD}' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_attributes_are_escaped() {
        let mut xml = Xml::new(None).unwrap();
        xml.open("a", &[("b", "<\"&'>\u{1}")]).unwrap();
        xml.text("c", "x < y & \u{0}z").unwrap();
        xml.close("a").unwrap();
        let expected = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\
            <a b=\"&lt;&quot;&amp;&apos;&gt;\u{FFFD}\"><c>x &lt; y &amp; \u{FFFD}z</c></a>";
        assert_eq!(xml.finish(), expected);
    }
}
