//! The one font of a certificate, and the part of it that a file needs.
//!
//! DejaVu Sans has the Latin, Greek, Cyrillic, Armenian and Georgian scripts, so the names of people in all of Europe. It is
//! embedded in the program, and each file embeds the glyphs that it uses. Scripts that are written from right to left need
//! more than one glyph after the other: they are refused ([`SheetFont::unprintable`]).

use std::collections::BTreeMap;

use pdf_writer::types::{CidFontType, FontFlags, SystemInfo, UnicodeCmap};
use pdf_writer::{Filter, Finish, Name, Pdf, Rect, Ref, Str};
use skrifa::charmap::Charmap;
use skrifa::instance::{LocationRef, Size};
use skrifa::metrics::{GlyphMetrics, Metrics};
use skrifa::{FontRef, MetadataProvider};
use subsetter::GlyphRemapper;

use super::IssueError;
use super::sheet::deflate;

/// DejaVu Sans 2.37; `font/LICENSE` has its licence.
const FONT: &[u8] = include_bytes!("font/DejaVuSans.ttf");

const IDENTITY: SystemInfo<'static> = SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };

/// Name of the font in a file; the letters before the sign say that it is a part.
const FONT_NAME: Name<'static> = Name(b"TROCAR+DejaVuSans");

/// The font, with the glyphs that were used.
pub(super) struct SheetFont {
    font: FontRef<'static>,
    charmap: Charmap<'static>,
    metrics: GlyphMetrics<'static>,
    used: GlyphRemapper,
    /// Each used glyph by its number in the file: its character and its width in thousandths of the size.
    glyphs: BTreeMap<u16, (char, f32)>,
}

impl SheetFont {
    pub(super) fn load() -> Result<Self, IssueError> {
        let font = FontRef::new(FONT).map_err(|error| IssueError::Font(error.to_string()))?;
        let metrics = font.glyph_metrics(Size::new(1000.0), LocationRef::default());
        Ok(Self { charmap: font.charmap(), metrics, used: GlyphRemapper::new(), glyphs: BTreeMap::new(), font })
    }

    /// The first character that cannot be printed.
    pub(super) fn unprintable(&self, text: &str) -> Option<char> {
        text.chars().find(|c| !is_invisible(*c) && (is_right_to_left(*c) || self.charmap.map(*c).is_none()))
    }

    /// Width of a text, in units of its size.
    pub(super) fn width(&self, text: &str) -> f32 {
        let glyphs = text.chars().filter(|c| !is_invisible(*c)).filter_map(|c| self.charmap.map(c));
        glyphs.map(|glyph| self.metrics.advance_width(glyph).unwrap_or_default()).sum::<f32>() / 1000.0
    }

    /// The text as the file shows it. Its glyphs are then part of the file.
    pub(super) fn encode(&mut self, text: &str) -> Vec<u8> {
        let mut encoded = Vec::with_capacity(2 * text.len());
        for c in text.chars().filter(|c| !is_invisible(*c)) {
            let Some(glyph) = self.charmap.map(c) else { continue };
            let Ok(id) = u16::try_from(glyph.to_u32()) else { continue };
            let number = self.used.remap(id);
            self.glyphs.insert(number, (c, self.metrics.advance_width(glyph).unwrap_or_default()));
            encoded.extend_from_slice(&number.to_be_bytes());
        }
        encoded
    }

    /// Writes the font with the used glyphs, as the object `id` and the four objects after it.
    pub(super) fn write(&self, pdf: &mut Pdf, id: Ref) -> Result<(), IssueError> {
        let part = subsetter::subset(FONT, 0, &self.used).map_err(|error| IssueError::Font(error.to_string()))?;
        let part = deflate(&part)?;
        let [cid, descriptor, file, to_unicode] = [1, 2, 3, 4].map(|step| Ref::new(id.get() + step));
        let mut font = pdf.type0_font(id);
        font.base_font(FONT_NAME).encoding_predefined(Name(b"Identity-H")).descendant_font(cid).to_unicode(to_unicode);
        font.finish();
        let mut font = pdf.cid_font(cid);
        font.subtype(CidFontType::Type2).base_font(FONT_NAME).system_info(IDENTITY).font_descriptor(descriptor);
        font.default_width(0.0).cid_to_gid_map_predefined(Name(b"Identity"));
        let mut widths = font.widths();
        for (number, (_, width)) in &self.glyphs {
            widths.same(*number, *number, *width);
        }
        widths.finish();
        font.finish();
        let metrics = Metrics::new(&self.font, Size::new(1000.0), LocationRef::default());
        let bounds = metrics.bounds.unwrap_or_default();
        let mut about = pdf.font_descriptor(descriptor);
        about.name(FONT_NAME).flags(FontFlags::SYMBOLIC).italic_angle(0.0).stem_v(90.0).font_file2(file);
        about.bbox(Rect::new(bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max));
        about.ascent(metrics.ascent).descent(metrics.descent).cap_height(metrics.cap_height.unwrap_or(metrics.ascent));
        about.finish();
        pdf.stream(file, &part).filter(Filter::FlateDecode);
        let mut map = UnicodeCmap::<u16>::new(Name(b"Trocar"), IDENTITY);
        for (number, (c, _)) in &self.glyphs {
            map.pair(*number, *c);
        }
        pdf.cmap(to_unicode, &map.finish());
        Ok(())
    }
}

/// Characters without a shape of their own.
fn is_invisible(c: char) -> bool {
    matches!(c, '\u{ad}' | '\u{200b}'..='\u{200f}' | '\u{2060}' | '\u{fe00}'..='\u{fe0f}' | '\u{feff}')
}

/// Characters of scripts that are written from right to left.
fn is_right_to_left(c: char) -> bool {
    matches!(c, '\u{590}'..='\u{8ff}' | '\u{fb1d}'..='\u{fdff}' | '\u{fe70}'..='\u{fefc}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_all_european_scripts_can_be_printed_and_others_are_named() {
        let font = SheetFont::load().unwrap();
        for name in [
            "Zoë Müller-Größer",
            "Łukasz Żółć",
            "Þórður Ægisson",
            "Ştefan Țîrlea",
            "Őrsi Űnige",
            "Νίκος Παπαδόπουλος",
            "Володимир Їжакевич",
            "Ђорђе Љубић",
            "Արամ Խաչատրյան",
            "გიორგი მელიქიშვილი",
            "Nguyễn Thị Ánh",
            "İğdır “Ada” O’Neill „x“",
        ] {
            assert_eq!(font.unprintable(name), None, "{name}");
            assert!(font.width(name) > 3.0);
        }
        for (name, c) in [("王小明", '王'), ("דנה", 'ד'), ("محمد", 'م'), ("Ada 🪡", '🪡')] {
            assert_eq!(font.unprintable(name), Some(c));
        }
        assert_eq!(font.unprintable("Grasper\u{ad}kurs"), None);
    }
}
