//! The sheet: one side of A4 with text, logo and QR code, written as a PDF.
//!
//! The text is laid out at the largest scale at which it fits on the page. The JSON of the content is an uncompressed object
//! of the file, so that it can be read without a parser of PDF.

use std::io::{Cursor, Write};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use image::{ImageReader, Limits, RgbImage, imageops};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};
use qrcodegen::{QrCode, QrCodeEcc};

use super::IssueError;
use super::font::SheetFont;
use super::words;
use crate::domain::centre::{Logo, MAX_LOGO_SIDE_PX};
use crate::domain::certificate::CertificateContent;

/// A4, points.
const PAGE: (f32, f32) = (595.0, 842.0);
const MARGIN: f32 = 57.0;
const WIDTH: f32 = PAGE.0 - 2.0 * MARGIN;
/// The code's side. Its modules are then at least 0.6 mm wide, which a phone reads at arm's length.
const QR_SIDE: f32 = 96.0;
/// Top of the block with the code, from the top of the page.
const FOOT_TOP: f32 = PAGE.1 - MARGIN - QR_SIDE;
/// Largest size of the logo.
const LOGO: (f32, f32) = (150.0, 56.0);
/// Pixels of the logo's longer side in the file: 300 per inch at its largest size.
const LOGO_PIXELS: u32 = 625;
/// Memory that reading a logo may take, bytes: 2048 × 2048 pixels of 16 bits, twice.
const MAX_LOGO_MEMORY: u64 = 80 << 20;
/// Scales that are tried, the largest first. At the smallest, text has 5.5 points.
const SCALES: [f32; 7] = [1.0, 0.92, 0.84, 0.76, 0.68, 0.6, 0.55];
const LEADING: f32 = 1.35;
/// With more sessions, their days are written in short.
const MAX_FULL_DAYS: usize = 40;

/// A piece of text at its place: left end of its base line, from the top of the page.
struct PlacedText {
    x: f32,
    y: f32,
    size: f32,
    text: String,
}

/// Texts below each other.
struct Column<'f> {
    font: &'f SheetFont,
    scale: f32,
    y: f32,
    placed: Vec<PlacedText>,
}

impl Column<'_> {
    /// Adds a paragraph of this size, with this space above it.
    fn paragraph(&mut self, text: &str, size: f32, space: f32) {
        self.y += space * self.scale;
        self.lines(text, size * self.scale, 0.0, WIDTH);
    }

    fn lines(&mut self, text: &str, size: f32, indent: f32, width: f32) {
        for line in wrapped(self.font, text, width / size) {
            self.y += size * LEADING;
            self.placed.push(PlacedText { x: MARGIN + indent, y: self.y, size, text: line });
        }
    }

    /// Adds items with a dash.
    fn list(&mut self, items: &[String], size: f32) {
        let size = size * self.scale;
        for item in items {
            self.placed.push(PlacedText { x: MARGIN, y: self.y + size * LEADING, size, text: "–".to_owned() });
            self.lines(item, size, 1.2 * size, WIDTH - 1.2 * size);
        }
    }

    /// Adds short items side by side, in as many columns as they fit into.
    fn grid(&mut self, items: &[String], size: f32) {
        let size = size * self.scale;
        let widest = items.iter().map(|item| self.font.width(item)).fold(1.0, f32::max) * size + 14.0;
        let fitting = ((WIDTH / widest) as usize).max(1);
        let columns = if items.len() <= 6 { 1 } else { fitting };
        let rows = items.len().div_ceil(columns);
        for (at, item) in items.iter().enumerate() {
            let (column, row) = ((at / rows) as f32, (at % rows + 1) as f32);
            let (x, y) = (MARGIN + column * WIDTH / columns as f32, self.y + row * size * LEADING);
            self.placed.push(PlacedText { x, y, size, text: item.clone() });
        }
        self.y += rows as f32 * size * LEADING;
    }
}

/// The PDF of a certificate, and where it has the content as JSON: offset and length.
pub(super) fn draw(content: &CertificateContent, logo: Option<&Logo>) -> Result<(Vec<u8>, (usize, usize)), IssueError> {
    let mut font = SheetFont::load()?;
    let json = serde_json::to_vec(content).map_err(|error| IssueError::Sheet(error.to_string()))?;
    let logo = logo.and_then(read_logo);
    let texts = lay_out(&font, content, logo.is_some())?;
    let mut page = Content::new();
    page.set_fill_gray(0.0);
    for PlacedText { x, y, size, text } in &texts {
        let shown = font.encode(text);
        page.begin_text().set_font(Name(b"F"), *size).next_line(*x, PAGE.1 - y).show(Str(&shown)).end_text();
    }
    page.set_line_width(0.7).move_to(MARGIN, PAGE.1 - FOOT_TOP + 14.0);
    page.line_to(PAGE.0 - MARGIN, PAGE.1 - FOOT_TOP + 14.0).stroke();
    draw_code(&mut page, &content.address)?;
    if let Some(logo) = &logo {
        let (width, height) = shown_size(logo);
        page.save_state();
        page.transform([width, 0.0, 0.0, height, PAGE.0 - MARGIN - width, PAGE.1 - MARGIN - height]);
        page.x_object(Name(b"L")).restore_state();
    }
    let pdf = write(content, &font, logo.as_ref(), &deflate(&page.finish())?, &json)?;
    let at = pdf.windows(json.len()).position(|bytes| bytes == json);
    let at = at.ok_or_else(|| IssueError::Sheet("the content is not in the file".to_owned()))?;
    Ok((pdf, (at, json.len())))
}

/// Places all text, at the largest scale at which it fits.
fn lay_out(font: &SheetFont, content: &CertificateContent, has_logo: bool) -> Result<Vec<PlacedText>, IssueError> {
    for scale in SCALES {
        let mut column = Column { font, scale, y: MARGIN, placed: Vec::new() };
        body(&mut column, content, has_logo);
        if column.y <= FOOT_TOP - 24.0 {
            let mut placed = column.placed;
            placed.extend(foot(font, content));
            for PlacedText { text, .. } in &placed {
                if let Some(character) = font.unprintable(text) {
                    return Err(IssueError::Unprintable { character, text: text.clone() });
                }
            }
            return Ok(placed);
        }
    }
    Err(IssueError::TooLong)
}

fn body(column: &mut Column<'_>, content: &CertificateContent, has_logo: bool) {
    let words = words::of(content.language);
    let centre = content.centre.as_deref().unwrap_or("Trocar");
    let top = column.y;
    let beside_logo = if has_logo { WIDTH - LOGO.0 - 20.0 } else { WIDTH };
    column.lines(centre, 13.0, 0.0, beside_logo);
    column.y = column.y.max(top + LOGO.1);
    column.paragraph(words.title, 27.0, 14.0);
    column.paragraph(words.certifies, 11.0, 14.0);
    column.paragraph(&content.trainee, 22.0, 2.0);
    column.paragraph(&words::has_met(content), 13.0, 6.0);
    column.paragraph(&words::how(content), 10.0, 6.0);
    column.paragraph(words::limits(content), 10.0, 12.0);
    match content.standard.limits.len() {
        0..=8 => column.list(&content.standard.limits, 10.0),
        _ => column.grid(&content.standard.limits, 9.0),
    }
    column.paragraph(words::sessions(content), 10.0, 12.0);
    let is_long = content.sessions.len() > MAX_FULL_DAYS;
    let sessions = content.sessions.iter().map(|session| words::session(content, session, is_long));
    let sessions: Vec<String> = sessions.collect();
    column.grid(&sessions, 9.0);
    if content.sessions.iter().any(|session| !session.day_known) {
        column.paragraph(words.claimed, 8.0, 6.0);
    }
    column.paragraph(&words::issued(content), 10.0, 14.0);
}

/// The text beside the code.
fn foot(font: &SheetFont, content: &CertificateContent) -> Vec<PlacedText> {
    let (x, width) = (MARGIN + QR_SIDE + 16.0, WIDTH - QR_SIDE - 16.0);
    let mut y = FOOT_TOP;
    let mut placed = Vec::new();
    let parts = [
        (words::of(content.language).check, 11.0),
        (content.address.as_str(), 8.0),
        (&words::how_to_check(content), 8.0),
    ];
    for (text, size) in parts {
        for line in wrapped(font, text, width / size) {
            y += size * LEADING;
            placed.push(PlacedText { x, y, size, text: line });
        }
        y += 3.0;
    }
    placed
}

/// Breaks a text into lines of at most this width, in units of its size; a longer word is broken anywhere.
fn wrapped(font: &SheetFont, text: &str, width: f32) -> Vec<String> {
    let mut lines = vec![String::new()];
    // A date has spaces that no line breaks at.
    let words = text.split(|c: char| c.is_whitespace() && c != '\u{a0}').filter(|word| !word.is_empty());
    for word in words {
        let line = lines.last_mut().map(std::mem::take).unwrap_or_default();
        let joined = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
        lines.pop();
        if font.width(&joined) <= width {
            lines.push(joined);
            continue;
        }
        if !line.is_empty() {
            lines.push(line);
        }
        let mut piece = String::new();
        for c in word.chars() {
            piece.push(c);
            if font.width(&piece) > width && piece.chars().count() > 1 {
                piece.pop();
                lines.push(std::mem::replace(&mut piece, c.to_string()));
            }
        }
        lines.push(piece);
    }
    lines
}

fn draw_code(page: &mut Content, address: &str) -> Result<(), IssueError> {
    let code = QrCode::encode_text(address, QrCodeEcc::Medium);
    let code = code.map_err(|_| IssueError::Sheet("the address is too long for a QR code".to_owned()))?;
    let (size, top) = (code.size(), PAGE.1 - FOOT_TOP);
    let side = QR_SIDE / size as f32;
    for row in 0..size {
        for column in (0..size).filter(|column| code.get_module(*column, row)) {
            page.rect(MARGIN + column as f32 * side, top - (row + 1) as f32 * side, side, side);
        }
    }
    page.fill_nonzero();
    Ok(())
}

/// The logo on white, no larger than it is printed; `None` if the file cannot be read: a certificate has no logo then.
fn read_logo(logo: &Logo) -> Option<RgbImage> {
    let mut reader = ImageReader::new(Cursor::new(&logo.bytes)).with_guessed_format().ok()?;
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_LOGO_SIDE_PX), Some(MAX_LOGO_SIDE_PX));
    limits.max_alloc = Some(MAX_LOGO_MEMORY);
    reader.limits(limits);
    let read = reader.decode().inspect_err(|error| tracing::warn!(%error, "logo not read; certificate without a logo"));
    let read = read.ok()?;
    let small =
        if read.width().max(read.height()) > LOGO_PIXELS { read.thumbnail(LOGO_PIXELS, LOGO_PIXELS) } else { read };
    let shown = small.to_rgba8();
    let mut white = image::RgbaImage::from_pixel(shown.width(), shown.height(), image::Rgba([255; 4]));
    imageops::overlay(&mut white, &shown, 0, 0);
    Some(image::DynamicImage::ImageRgba8(white).to_rgb8())
}

/// Width and height of the logo on the sheet.
fn shown_size(logo: &RgbImage) -> (f32, f32) {
    let (width, height) = (logo.width() as f32, logo.height() as f32);
    let scale = (LOGO.0 / width).min(LOGO.1 / height);
    (width * scale, height * scale)
}

fn write(
    content: &CertificateContent,
    font: &SheetFont,
    logo: Option<&RgbImage>,
    page_bytes: &[u8],
    json: &[u8],
) -> Result<Vec<u8>, IssueError> {
    let [catalog, pages, page, shown, picture, facts, about] = [1, 2, 3, 4, 5, 6, 7].map(Ref::new);
    let font_id = Ref::new(10);
    let mut pdf = Pdf::new();
    let mut root = pdf.catalog(catalog);
    root.pages(pages).lang(TextStr(content.language.name())).viewer_preferences().display_doc_title(true);
    root.pair(Name(b"TrocarCertificate"), facts);
    root.finish();
    let title = format!("{}: {}, {}", words::of(content.language).title, content.trainee, content.task);
    let mut info = pdf.document_info(about);
    info.title(TextStr(&title)).producer(TextStr(&format!("Trocar {}", content.program)));
    info.finish();
    pdf.pages(pages).kids([page]).count(1);
    let mut sheet = pdf.page(page);
    sheet.media_box(Rect::new(0.0, 0.0, PAGE.0, PAGE.1)).parent(pages).contents(shown);
    let mut resources = sheet.resources();
    resources.fonts().pair(Name(b"F"), font_id);
    if logo.is_some() {
        resources.x_objects().pair(Name(b"L"), picture);
    }
    resources.finish();
    sheet.finish();
    pdf.stream(shown, page_bytes).filter(Filter::FlateDecode);
    if let Some(logo) = logo {
        let pixels = deflate(logo.as_raw())?;
        let mut image = pdf.image_xobject(picture, &pixels);
        image.filter(Filter::FlateDecode);
        image.width(logo.width() as i32).height(logo.height() as i32).bits_per_component(8);
        image.color_space().device_rgb();
    }
    pdf.stream(facts, json);
    font.write(&mut pdf, font_id)?;
    Ok(pdf.finish())
}

pub(super) fn deflate(bytes: &[u8]) -> Result<Vec<u8>, IssueError> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    let written = encoder.write_all(bytes).and_then(|()| encoder.finish());
    written.map_err(|error| IssueError::Sheet(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::certificate::key::CertificateSigner;
    use crate::domain::certificate::signed_file::{self, SignatureVerdict};
    use crate::domain::certificate::{CertificateLanguage, CertifiedSession};

    fn content(sessions: usize, limits: usize) -> CertificateContent {
        let signer = CertificateSigner::from_seed([7; 32]).unwrap();
        let mut content = signed_file::tests::content(&signer);
        let session = |at| CertifiedSession {
            number: at + 1,
            recorded_on: "2026-11-30".to_owned(),
            day_known: at % 3 > 0,
            supervision: None,
        };
        content.sessions = (0..sessions).map(session).collect();
        content.standard.limits = vec!["Path length, dominant hand: at most 300 mm".to_owned(); limits];
        content
    }

    #[test]
    fn the_signed_sheet_contains_its_content_and_any_changed_byte_is_refused() {
        let signer = CertificateSigner::from_seed([7; 32]).unwrap();
        let content = content(3, 2);
        let (pdf, at) = draw(&content, None).unwrap();
        let file = signed_file::sign(pdf, at, &signer);
        let key = signer.public().id();
        let keys = [signer.public()];
        let genuine = SignatureVerdict::Genuine { content: Box::new(content), key };
        assert_eq!(signed_file::verify(&file, &keys), genuine);
        assert!(file.len() < 100_000, "{} bytes", file.len());
        for at in (0..file.len()).step_by(97) {
            let mut changed = file.clone();
            changed[at] ^= 1;
            assert!(!matches!(signed_file::verify(&changed, &keys), SignatureVerdict::Genuine { .. }), "byte {at}");
        }
    }

    #[test]
    fn all_that_a_certificate_may_say_fits_on_one_page() {
        for language in [CertificateLanguage::En, CertificateLanguage::De] {
            for (sessions, limits) in [(1, 1), (10, 4), (60, 10), (120, 20)] {
                let mut content = CertificateContent { language, ..content(sessions, limits) };
                content.trainee = "Wolfeschlegelsteinhausenbergerdorff ".repeat(3);
                draw(&content, None).unwrap_or_else(|error| panic!("{sessions} sessions, {limits} limits: {error}"));
            }
        }
        assert!(matches!(draw(&content(5000, 20), None), Err(IssueError::TooLong)));
    }

    #[test]
    fn a_name_that_cannot_be_printed_is_refused_with_its_character() {
        let refused = draw(&CertificateContent { trainee: "王小明".to_owned(), ..content(1, 1) }, None);
        assert!(matches!(refused, Err(IssueError::Unprintable { character: '王', .. })));
    }

    #[test]
    fn a_logo_is_drawn_and_a_broken_one_is_left_out() {
        let mut file = Vec::new();
        let picture = image::RgbaImage::from_pixel(900, 300, image::Rgba([200, 0, 0, 128]));
        picture.write_to(&mut Cursor::new(&mut file), image::ImageFormat::Png).unwrap();
        let logo = Logo::new(file.clone()).unwrap();
        let read = read_logo(&logo).unwrap();
        assert_eq!((read.width(), read.height()), (625, 208));
        let pink = read.get_pixel(0, 0).0;
        assert!(pink[0] > 220 && (120..140).contains(&pink[1]), "{pink:?}");
        let broken = Logo::new(file[..file.len() / 2].to_vec()).unwrap();
        assert!(read_logo(&broken).is_none());
        assert!(
            draw(&content(1, 1), Some(&logo)).unwrap().0.len() > draw(&content(1, 1), Some(&broken)).unwrap().0.len()
        );
    }
}
