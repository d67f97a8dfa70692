//! Photo formats that are recognised but not decoded, so that a refusal can name the format and the way out.
//!
//! Each decoder is code that files of strangers reach. JPEG, PNG and BMP are what cameras and programs write without
//! being asked; every program that shows one of the formats below also saves it as one of those.

use image::ImageFormat;

/// Number of first bytes of a file that show its format.
pub(super) const FORMAT_BYTES: usize = 64;

/// Brands of a HEIF file: photos and sequences coded with H.265, and the brand of the container itself.
const HEIF_BRANDS: [&[u8]; 9] = [b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"hevm", b"mif1", b"msf1"];

/// A photo format that is not decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnreadFormat {
    /// HEIF with H.265: the usual format of an iPhone.
    #[error("HEIC")]
    Heic,
    /// HEIF with AV1.
    #[error("AVIF")]
    Avif,
    /// WebP.
    #[error("WebP")]
    WebP,
    /// TIFF, and the raw formats of cameras that are built on it (DNG, NEF, CR2, ARW).
    #[error("TIFF or raw")]
    Tiff,
    /// GIF.
    #[error("GIF")]
    Gif,
    /// JPEG XL.
    #[error("JPEG XL")]
    JpegXl,
    /// JPEG 2000.
    #[error("JPEG 2000")]
    Jpeg2000,
    /// Another format of pictures.
    #[error("{}", .0.extensions_str().first().copied().unwrap_or("another").to_uppercase())]
    Other(ImageFormat),
}

impl UnreadFormat {
    /// The format of a file with these first bytes, if it is a photo of a format that is not decoded.
    pub(super) fn of(first_bytes: &[u8]) -> Option<Self> {
        let box_type = first_bytes.get(4..8).unwrap_or_default();
        let brand = first_bytes.get(8..12).unwrap_or_default();
        match image::guess_format(first_bytes) {
            Ok(ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::Bmp) => None,
            Ok(ImageFormat::Avif) => Some(Self::Avif),
            Ok(ImageFormat::WebP) => Some(Self::WebP),
            Ok(ImageFormat::Tiff) => Some(Self::Tiff),
            Ok(ImageFormat::Gif) => Some(Self::Gif),
            Ok(other) => Some(Self::Other(other)),
            Err(_) if box_type == b"ftyp" && HEIF_BRANDS.contains(&brand) => Some(Self::Heic),
            Err(_) if box_type == b"JXL " || first_bytes.starts_with(b"\xff\x0a") => Some(Self::JpegXl),
            Err(_) if box_type == b"jP  " => Some(Self::Jpeg2000),
            Err(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_format_is_named_and_what_is_decoded_or_no_photo_is_not() {
        let named: [(&[u8], &str); 9] = [
            (b"\0\0\0\x18ftypheic\0\0\0\0mif1heic", "HEIC"),
            (b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic", "HEIC"),
            (b"\0\0\0\x18ftypavif\0\0\0\0", "AVIF"),
            (b"RIFF\x10\0\0\0WEBPVP8 ", "WebP"),
            (b"II*\0\x08\0\0\0", "TIFF or raw"),
            (b"GIF89a", "GIF"),
            (b"\0\0\0\x0cJXL \r\n\x87\n", "JPEG XL"),
            (b"\0\0\0\x0cjP  \r\n\x87\n", "JPEG 2000"),
            (b"P6\n640 480\n255\n", "PBM"),
        ];
        for (bytes, name) in named {
            assert_eq!(UnreadFormat::of(bytes).unwrap().to_string(), name);
        }
        let others: [&[u8]; 7] = [
            b"",
            b"BM",
            b"\xff\xd8\xff\xe0",
            b"\x89PNG\r\n\x1a\n",
            b"dear diary",
            b"\0\0\0\x18ftypisom",
            b"\0\0\0\x18ftypqt  ",
        ];
        for bytes in others {
            assert_eq!(UnreadFormat::of(bytes), None, "{bytes:?}");
        }
    }
}
