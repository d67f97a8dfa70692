//! The centre's logo: a PNG or JPEG file that browsers show as it was sent. Only its header is read, never its pixels.

use sha2::{Digest, Sha256};

use super::named;
use super::text::Invalid;

/// Largest file, bytes. Every page loads it once, also over a phone.
pub const MAX_LOGO_BYTES: usize = 512 * 1024;

/// Largest width and height, pixels: a small file can hold a picture that takes a browser gigabytes to show.
pub const MAX_LOGO_SIDE_PX: u32 = 2048;

const PNG_SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

named! {
    /// The format of a logo, by its media type.
    LogoFormat: "logo" {
        /// PNG.
        Png = "image/png",
        /// JPEG.
        Jpeg = "image/jpeg",
    }
}

/// The file of a logo with its format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Logo {
    /// Its format.
    pub format: LogoFormat,
    /// The file.
    pub bytes: Vec<u8>,
}

impl Logo {
    /// A logo that was sent. Its first bytes decide what it is, not what the sender says.
    pub fn new(bytes: Vec<u8>) -> Result<Self, Invalid> {
        if bytes.len() > MAX_LOGO_BYTES {
            let why = format!("has {} bytes; send a picture of at most {MAX_LOGO_BYTES}", bytes.len());
            return Err(Invalid::new("logo", why));
        }
        let read = png_size(&bytes).map(|size| (LogoFormat::Png, size));
        let read = read.or_else(|| jpeg_size(&bytes).map(|size| (LogoFormat::Jpeg, size)));
        let Some((format, (width, height))) = read else {
            return Err(Invalid::new("logo", "is no PNG or JPEG picture; save it as one of these and send it again"));
        };
        let sides = 1..=MAX_LOGO_SIDE_PX;
        if !(sides.contains(&width) && sides.contains(&height)) {
            let why = format!("has {width} × {height} pixels; send a picture of at most {MAX_LOGO_SIDE_PX} a side");
            return Err(Invalid::new("logo", why));
        }
        Ok(Self { format, bytes })
    }

    /// The SHA-256 of the file, hexadecimal.
    pub fn hash(&self) -> String {
        Sha256::digest(&self.bytes).iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// Width and height of a PNG file: its first chunk is the header.
fn png_size(file: &[u8]) -> Option<(u32, u32)> {
    let header = file.strip_prefix(PNG_SIGNATURE)?.strip_prefix(b"\0\0\0\rIHDR")?;
    Some((big_endian(header.get(..4)?), big_endian(header.get(4..8)?)))
}

/// Width and height of a JPEG file, from its first frame header.
fn jpeg_size(file: &[u8]) -> Option<(u32, u32)> {
    let mut rest = file.strip_prefix(b"\xff\xd8")?;
    loop {
        let [0xff, marker, tail @ ..] = rest else { return None };
        match marker {
            0xff => rest = rest.get(1..)?, // fill byte
            // Start of frame: length, bits, height, width. C4, C8 and CC are other segments.
            0xc0..=0xcf if !matches!(marker, 0xc4 | 0xc8 | 0xcc) => {
                return Some((big_endian(tail.get(5..7)?), big_endian(tail.get(3..5)?)));
            }
            0xd8..=0xda => return None, // the picture begins, or ends, without a frame header
            _ => {
                let length = big_endian(tail.get(..2)?) as usize;
                rest = tail.get(length.max(2)..)?;
            }
        }
    }
}

fn big_endian(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |number, byte| (number << 8) | u32::from(*byte))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn png(width: u32, height: u32) -> Vec<u8> {
        [PNG_SIGNATURE, b"\0\0\0\rIHDR", &width.to_be_bytes(), &height.to_be_bytes(), b"\x08\x06\0\0\0"].concat()
    }

    /// A JPEG file with a comment and a table of codes before its frame header.
    fn jpeg(width: u16, height: u16) -> Vec<u8> {
        let frame = [b"\xff\xc2\0\x11\x08".as_slice(), &height.to_be_bytes(), &width.to_be_bytes(), b"\x03"].concat();
        [b"\xff\xd8\xff\xfe\0\x04hi\xff\xc4\0\x03x\xff".as_slice(), &frame].concat()
    }

    #[test]
    fn the_header_says_format_and_size() {
        assert_eq!(png_size(&png(640, 480)), Some((640, 480)));
        assert_eq!(jpeg_size(&jpeg(640, 480)), Some((640, 480)));
        assert_eq!(Logo::new(png(640, 480)).unwrap().format, LogoFormat::Png);
        assert_eq!(Logo::new(jpeg(640, 480)).unwrap().format, LogoFormat::Jpeg);
    }

    #[test]
    fn what_browsers_should_not_show_is_refused_with_the_way_out() {
        let why = |bytes: Vec<u8>| Logo::new(bytes).unwrap_err().to_string();
        for other in
            [b"<svg xmlns='http://www.w3.org/2000/svg'/>".as_slice(), b"GIF89a", b"", b"\xff\xd8\xff\xda\0\x02"]
        {
            assert!(why(other.to_vec()).contains("no PNG or JPEG"), "{other:?}");
        }
        assert!(why(png(30_000, 16)).contains("30000 × 16 pixels"));
        assert!(why(png(0, 16)).contains("0 × 16"));
        assert!(why(jpeg(16, 2049)).contains("2049"));
        assert!(why(vec![0; MAX_LOGO_BYTES + 1]).contains("at most 524288"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(start in 0_usize..3, bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let start = [b"".as_slice(), PNG_SIGNATURE, b"\xff\xd8\xff\xc4"][start];
            if let Ok(logo) = Logo::new([start, &bytes].concat()) {
                prop_assert!(logo.bytes.len() > 8);
            }
        }
    }
}
