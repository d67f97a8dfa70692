//! Says why FFmpeg could not open a recording, where the file's first bytes show it better than FFmpeg's error does.
//!
//! "Invalid data" is FFmpeg's word for an MP4 file whose recorder was killed before it wrote the index, and "Invalid
//! argument" for every container that is not accepted.

use std::io::{Read, Seek, SeekFrom};

use super::photo;

/// Number of first bytes that show a format.
const HEAD_BYTES: u64 = 64;
/// Maximum number of boxes at the top of an MP4 file that are looked at. A usual file has three to ten, a fragmented
/// one two for each fragment; its index comes first.
const MAX_BOXES: usize = 4096;

/// Why a recording cannot be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum UnreadRecording {
    /// An MP4 or MOV file without its index, or with a part of it.
    CutOff,
    /// A container that is not accepted: its name, and how to convert it.
    Container(&'static str, &'static str),
    /// A photo.
    Photo,
}

/// Boxes that an MP4 or MOV file may begin with.
const MP4_FIRST: [&[u8]; 6] = [b"ftyp", b"wide", b"mdat", b"free", b"skip", b"moov"];

/// Copies the video as it is.
const COPY: &str = "ffmpeg -fflags +genpts -i IN -c copy OUT.mkv";
/// Encodes the video again, because its codec is not accepted either.
const ENCODE: &str = "ffmpeg -i IN -crf 18 OUT.mp4";

/// First bytes of containers that are not accepted, their names, and how to convert them.
const CONTAINERS: [(&[u8], &str, &str); 8] = [
    (b"\0\0\x01\xba", "MPEG program stream (.mpg, .vob)", COPY),
    (b"\0\0\x01\xb3", "MPEG video without a container", COPY),
    (b"\0\0\0\x01", "H.264 or H.265 without a container", COPY),
    (b"FLV", "Flash video (.flv)", COPY),
    (b"\x06\x0e\x2b\x34", "MXF", COPY),
    (b"\x30\x26\xb2\x75", "Windows Media (.wmv, .asf)", ENCODE),
    (b"OggS", "Ogg (.ogv)", ENCODE),
    (b".RMF", "RealMedia (.rm)", ENCODE),
];

impl UnreadRecording {
    /// What the file's bytes show; `None` if they show nothing that explains a failure. The file is rewound.
    pub fn of(file: &mut (impl Read + Seek)) -> Option<Self> {
        let found = Self::find(file).ok().flatten();
        file.rewind().ok()?;
        found
    }

    fn find(file: &mut (impl Read + Seek)) -> std::io::Result<Option<Self>> {
        let mut head = Vec::new();
        file.by_ref().take(HEAD_BYTES).read_to_end(&mut head)?;
        if head.get(4..8).is_some_and(|kind| MP4_FIRST.contains(&kind)) {
            return Ok((!has_whole_index(file)?).then_some(Self::CutOff));
        }
        if let Some((_, name, convert)) = CONTAINERS.iter().find(|(magic, ..)| head.starts_with(magic)) {
            return Ok(Some(Self::Container(name, convert)));
        }
        Ok(photo::is_photo(&head).then_some(Self::Photo))
    }
}

/// Whether an MP4 file holds its index (`moov`) to the end.
fn has_whole_index(file: &mut (impl Read + Seek)) -> std::io::Result<bool> {
    let end = file.seek(SeekFrom::End(0))?;
    let mut at = 0;
    for _ in 0..MAX_BOXES {
        let Some((kind, size)) = box_at(file, at, end)? else { return Ok(false) };
        let next = at.saturating_add(size);
        if &kind == b"moov" {
            return Ok(next <= end);
        }
        at = next;
    }
    Ok(true) // unknown
}

/// Kind and size of the box at a position, bytes; `None` at the end of the file.
fn box_at(file: &mut (impl Read + Seek), at: u64, end: u64) -> std::io::Result<Option<([u8; 4], u64)>> {
    const SHORT_HEAD: u64 = 8;
    const LONG_HEAD: u64 = 16;
    if end.saturating_sub(at) < SHORT_HEAD {
        return Ok(None);
    }
    file.seek(SeekFrom::Start(at))?;
    let mut head = [0; SHORT_HEAD as usize];
    file.read_exact(&mut head)?;
    let [a, b, c, d, kind @ ..] = head;
    let size = match u64::from(u32::from_be_bytes([a, b, c, d])) {
        0 => end - at, // to the end of the file
        1 => {
            let mut long = [0; (LONG_HEAD - SHORT_HEAD) as usize];
            if file.read_exact(&mut long).is_err() {
                return Ok(None);
            }
            u64::from_be_bytes(long).max(LONG_HEAD)
        }
        size => size.max(SHORT_HEAD),
    };
    Ok(Some((kind, size)))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use crate::media::testing::recording;
    use crate::media::{MediaError, MediaLimits, SampleFormat, VideoFile};

    fn refusal(bytes: Vec<u8>) -> MediaError {
        match VideoFile::open(Cursor::new(bytes), MediaLimits::default()) {
            Ok(_) => panic!("it was opened"),
            Err(error) => error,
        }
    }

    /// The bytes with the index renamed, so that it is not found: as of a recorder that did not write it.
    fn without_index(mut bytes: Vec<u8>) -> Vec<u8> {
        let at = bytes.windows(4).position(|four| four == b"moov").unwrap();
        bytes[at..at + 4].copy_from_slice(b"junk");
        bytes
    }

    #[test]
    fn a_recording_without_its_whole_index_was_cut_off_and_a_whole_one_was_not() {
        let whole = recording(SampleFormat::Yuv420, 30);
        assert_eq!(UnreadRecording::of(&mut Cursor::new(&whole)), None);
        let index_at = whole.windows(4).position(|four| four == b"moov").unwrap();
        let mut open_ended = whole[..index_at - 4].to_vec(); // ends with the pictures
        let data_at = open_ended.windows(4).position(|four| four == b"mdat").unwrap();
        open_ended[data_at - 4..data_at].fill(0); // the size is not known yet
        for cut in [without_index(whole), open_ended] {
            let refused = refusal(cut);
            assert!(matches!(refused, MediaError::CutOff), "{refused}");
            assert!(refused.to_string().contains("before its index was written"), "{refused}");
        }
    }

    #[test]
    fn containers_that_are_not_accepted_are_named_with_a_conversion() {
        let mut program_stream = b"\0\0\x01\xba\x44\0\x04\0\x04\x01".to_vec();
        program_stream.resize(4096, 0xff);
        let text = refusal(program_stream).to_string();
        assert!(text.contains("MPEG program stream") && text.contains("-c copy OUT.mkv"), "{text}");
        let text = refusal(b"OggS\0\x02\0\0\0\0".to_vec()).to_string();
        assert!(text.contains("Ogg") && text.contains("OUT.mp4"), "{text}");
        let text = refusal(b"\xff\xd8\xff\xe0\0\x10JFIF\0".to_vec()).to_string();
        assert!(text.contains("this file is a picture, not a video"), "{text}");
        for unknown in [&b"dear diary"[..], b"", b"\x1a\x45\xdf\xa3 but nothing else"] {
            let text = refusal(unknown.to_vec()).to_string();
            assert!(!text.contains("Invalid argument") && text.contains("accepted are MP4/MOV"), "{text}");
        }
    }

    #[test]
    fn sizes_of_boxes_that_lead_nowhere_end_the_search() {
        for sizes in [[0_u32, 0], [1, 1], [8, 8], [u32::MAX, u32::MAX]] {
            let mut bytes = [&sizes[0].to_be_bytes()[..], b"ftyp", &sizes[1].to_be_bytes(), b"free"].concat();
            bytes.extend([0; 5]);
            assert_eq!(UnreadRecording::of(&mut Cursor::new(bytes)), Some(UnreadRecording::CutOff));
        }
    }
}
