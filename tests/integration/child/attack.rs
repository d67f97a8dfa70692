//! Files made to do harm: to read other files, to hang, to fill the memory. Each one ends soon, with a reason.
//!
//! A secret text and another person's recording lie in the same folder. Their content and size are unique, so that a
//! leak shows.

use super::forge::*;
use super::*;

/// Text that no child may reveal.
const SECRET: &str = "MARKER-7f3a9c51";

/// Size of the other person's recording, macroblocks; no attack has this size.
const FOREIGN: H264 = H264 { columns: 13, rows: 7, references: 1 };
const FOREIGN_SIZE: (u32, u32) = (13 * 16, 7 * 16);

/// Maximum memory that a child may hold during an attack, bytes.
const MAX_MEMORY_BYTES: u64 = 512 << 20;

/// How an attack may end.
#[derive(Clone, Copy, PartialEq)]
enum AllowedEnd {
    /// With a problem.
    Refused,
    /// With a problem, or with frames of the attack file itself.
    Harmless,
}

struct Attack {
    name: &'static str,
    bytes: Vec<u8>,
    end: AllowedEnd,
}

fn refused(name: &'static str, bytes: impl Into<Vec<u8>>) -> Attack {
    Attack { name, bytes: bytes.into(), end: AllowedEnd::Refused }
}

fn harmless(name: &'static str, bytes: impl Into<Vec<u8>>) -> Attack {
    Attack { name, bytes: bytes.into(), end: AllowedEnd::Harmless }
}

/// Texts that a demuxer may read as a list of other files. `foreign` and `secret` are absolute paths.
fn playlists(foreign: &str, secret: &str) -> Vec<Attack> {
    let hls = |entry: &str| format!("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{entry}\n");
    let dash = format!(
        "<?xml version=\"1.0\"?><MPD xmlns=\"urn:mpeg:dash:schema:mpd:2011\" type=\"static\" \
         mediaPresentationDuration=\"PT2S\"><Period><AdaptationSet mimeType=\"video/mp4\"><Representation id=\"1\" \
         bandwidth=\"1\"><BaseURL>{foreign}</BaseURL></Representation></AdaptationSet></Period></MPD>"
    );
    vec![
        refused("ffconcat, relative", "ffconcat version 1.0\nfile foreign.mp4\n"),
        refused("ffconcat, absolute", format!("ffconcat version 1.0\nfile '{foreign}'\n")),
        refused("ffconcat, secret", format!("ffconcat version 1.0\nfile '{secret}'\noption safe 0\n")),
        refused("ffconcat, itself", "ffconcat version 1.0\nfile attack.mp4\nfile attack.mp4\n"),
        refused("HLS", format!("{}#EXT-X-ENDLIST\n", hls(foreign))),
        refused("HLS that never ends", hls(foreign)),
        refused("HLS, file URL", hls(&format!("file://{foreign}"))),
        refused("HLS, HTTP", hls("http://127.0.0.1:1/x.ts")),
        refused("HLS, data URL", hls("data:video/mp2t;base64,R0AREAA=")),
        refused("HLS, concat protocol", hls(&format!("concat:{secret}|{foreign}"))),
        refused("HLS, key", format!("#EXTM3U\n#EXT-X-KEY:METHOD=AES-128,URI=\"{secret}\"\n#EXTINF:1,\n{foreign}\n")),
        refused("HLS, master", format!("#EXTM3U\n#EXT-X-STREAM-INF:BANDWIDTH=1\n{foreign}\n")),
        refused("DASH", dash),
        refused("SDP", "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 4 RTP/AVP 96\n"),
        refused("ffmetadata", ";FFMETADATA1\ntitle=x\n[CHAPTER]\nTIMEBASE=1/0\nSTART=-1\nEND=9\n"),
        refused("VobSub index", format!("# VobSub index file, v7\nid: en, index: 0\n{secret}\n")),
        refused("IMF", "<?xml version=\"1.0\"?><CompositionPlaylist><Id>urn:uuid:0</Id></CompositionPlaylist>"),
        refused("RealMedia list", format!("rtsp://127.0.0.1/x\nfile://{secret}\n")),
        refused("subtitles", "1\n00:00:00,000 --> 00:00:01,000\n<img src=/etc/passwd>\n"),
        refused("image pattern", "foreign%03d.png\n"),
        refused("SVG", format!("<svg xmlns:xlink='x'><image xlink:href='{secret}'/></svg>")),
    ]
}

/// MP4 files that refer to other files, state counts that are too large or contradict themselves.
fn movies(foreign: &str) -> Vec<Attack> {
    let alias = {
        let mut record = vec![0; 150];
        record[..4].copy_from_slice(&be(&[0]));
        record.extend(18u16.to_be_bytes());
        record.extend((foreign.len() as u16).to_be_bytes());
        record.extend(foreign.as_bytes());
        full("alis", &record)
    };
    let url = |address: &str| full("url ", &[address.as_bytes(), &[0]].concat());
    let reference_movie = {
        let rdrf = full("rdrf", &[b"url ".to_vec(), be(&[foreign.len() as u32]), foreign.into()].concat());
        atom("moov", &atom("rmra", &atom("rmda", &rdrf)))
    };
    let counts = |name: &str, count: u32| full(name, &be(&[count, u32::MAX]));
    let nested = (0..20_000)
        .fold(Vec::new(), |inner: Vec<u8>, _| [be(&[inner.len() as u32 + 8]), b"moov".to_vec(), inner].concat());
    let trun = |samples: u32| {
        let tfhd = full("tfhd", &be(&[1]));
        let mfhd = full("mfhd", &be(&[1]));
        atom("moof", &[mfhd, atom("traf", &[tfhd, full("trun", &be(&[samples]))].concat())].concat())
    };
    let fragmented = |samples: u32| {
        let mut movie = Movie { samples: vec![], ..Movie::valid() };
        movie.duration = 0;
        let mvex = atom("mvex", &full("trex", &be(&[1, 1, 1, 0, 0])));
        let mut moov = movie.moov(0);
        moov.extend(mvex);
        let length = (moov.len() as u32).to_be_bytes();
        moov[..4].copy_from_slice(&length);
        [atom("ftyp", b"isom\0\0\0\x01iso5"), moov, trun(samples)].concat()
    };
    vec![
        harmless("MP4, alias to another file", Movie { dref: alias, ..Movie::valid() }.bytes()),
        harmless(
            "MP4, URL of another file",
            Movie { dref: url(&format!("file://{foreign}")), ..Movie::valid() }.bytes(),
        ),
        harmless("MP4, data URL", Movie { dref: url("data:video/mp4;base64,AAAA"), ..Movie::valid() }.bytes()),
        refused("MP4, reference movie", [atom("ftyp", b"qt  \0\0\0\0qt  "), reference_movie].concat()),
        refused("MP4, atom of 8 EiB", [atom("ftyp", b"isomisom"), be(&[1]), b"moov".to_vec(), vec![0x7f; 8]].concat()),
        refused("MP4, nested 20,000 deep", [atom("ftyp", b"isomisom"), nested].concat()),
        refused("MP4, 100,000 tracks", Movie { tracks: 100_000, samples: vec![], ..Movie::valid() }.bytes()),
        refused("MP4, no samples", Movie { samples: vec![], ..Movie::valid() }.bytes()),
        refused("MP4, samples of 2³²−1", Movie { stsz: Some(counts("stsz", 1)), ..Movie::valid() }.bytes()),
        refused(
            "MP4, two thousand million samples of one byte",
            Movie {
                stsz: Some(full("stsz", &be(&[1, 2_000_000_000]))),
                stts: Some(full("stts", &be(&[1, 2_000_000_000, 1]))),
                ..Movie::valid()
            }
            .bytes(),
        ),
        harmless(
            "MP4, time table beyond the file",
            Movie { stts: Some(counts("stts", u32::MAX)), ..Movie::valid() }.bytes(),
        ),
        harmless(
            "MP4, steps of 2³¹ ticks",
            Movie { stts: Some(full("stts", &be(&[1, 50, i32::MAX as u32]))), ..Movie::valid() }.bytes(),
        ),
        harmless(
            "MP4, negative steps",
            Movie { stts: Some(full("stts", &be(&[1, 50, u32::MAX]))), ..Movie::valid() }.bytes(),
        ),
        harmless("MP4, zero timescale", Movie { timescale: 0, ..Movie::valid() }.bytes()),
        harmless("MP4, negative duration", Movie { duration: u32::MAX, ..Movie::valid() }.bytes()),
        harmless(
            "MP4, edit list of 2³² entries",
            Movie { edits: atom("edts", &counts("elst", u32::MAX)), ..Movie::valid() }.bytes(),
        ),
        harmless(
            "MP4, edits of negative length",
            Movie {
                edits: atom("edts", &full("elst", &be(&[2, u32::MAX, 0, 0, 50, u32::MAX - 3, 0xffff_0000]))),
                ..Movie::valid()
            }
            .bytes(),
        ),
        refused("MP4, fragment of 2³² samples", fragmented(u32::MAX)),
        refused("MP4, fragment of 20,000,000 samples", fragmented(20_000_000)),
    ]
}

/// Pictures that are too large, are cut off or change their size.
fn pictures() -> Vec<Attack> {
    let bomb = || H264 { columns: 1024, rows: 544, references: 16 };
    let truncated = {
        let mut movie = Movie::valid();
        for sample in &mut movie.samples {
            sample.truncate(7);
            sample[..4].copy_from_slice(&be(&[0x7fff_ffff]));
        }
        movie
    };
    let no_slices = Movie { samples: vec![sized(&[0x65]), sized(&[0x41]), vec![0, 0, 0, 0]], ..Movie::valid() };
    let grey = |columns, rows| H264 { columns, rows, references: 1 };
    let changing = {
        let (small, large) = (grey(20, 15), grey(40, 30));
        let parameters = [sized(&large.sps()), sized(&H264::pps())].concat();
        let mut movie = Movie::of(small, 5);
        movie.samples.push([parameters, sized(&large.key_frame())].concat());
        movie
    };
    let jpeg_of_65535 = {
        let sof =
            [&[0xff, 0xd8, 0xff, 0xc0, 0, 17, 8, 0xff, 0xff, 0xff, 0xff, 3][..], &[1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0]];
        [sof.concat(), vec![0xff, 0xda, 0, 12, 3, 1, 0, 2, 0, 3, 0, 0, 63, 0], vec![0; 64], vec![0xff, 0xd9]].concat()
    };
    let vp8_of_16383 = vec![0x10, 0, 0, 0x9d, 1, 0x2a, 0xff, 0x3f, 0xff, 0x3f, 0, 0, 0, 0];
    vec![
        refused("H.264 of 16384×8704", Movie::of(bomb(), 12).bytes()),
        refused(
            "H.264 of 16384×8704 in Matroska",
            matroska(&[matroska_tracks(&bomb(), 1), matroska_cluster(&bomb().samples(3))]),
        ),
        refused("H.264 of 8192×4320", Movie::of(H264 { columns: 512, rows: 270, references: 16 }, 20).bytes()),
        refused("H.264 units longer than the file", truncated.bytes()),
        refused("H.264 without a slice", no_slices.bytes()),
        refused("H.264 that changes its size", changing.bytes()),
        refused("JPEG of 65535×65535", avi(b"MJPG", [320, 240], &vec![jpeg_of_65535; 3], 1, &[])),
        refused("VP8 of 16383×16383", avi(b"VP80", [320, 240], &vec![vp8_of_16383; 3], 1, &[])),
    ]
}

/// Matroska files that refer to other files, to themselves or to nothing.
fn matroskas() -> Vec<Attack> {
    let grey = H264 { columns: 20, rows: 15, references: 1 };
    let tracks = || matroska_tracks(&grey, 1);
    let cluster = || matroska_cluster(&grey.samples(5));
    let linked = {
        let other = |id: u32| element(id, &[7; 16]);
        element(0x1549_a966, &[other(0x73a4), other(0x3cb923), other(0x3eb923), element(0x4444, &[7; 16])].concat())
    };
    let nested = (0..5_000).fold(Vec::new(), |inner, _| element(0x1549_a966, &inner));
    let seek = |id: u32, at: u64| {
        let seek = [element(0x53ab, &id.to_be_bytes()), element(0x53ac, &at.to_be_bytes())].concat();
        element(0x114d_9b74, &element(0x4dbb, &seek))
    };
    let huge = |id: u32| element_of_length(id, (1 << 56) - 2, &[0; 64]);
    vec![
        harmless("Matroska, linked segments", matroska(&[linked, tracks(), cluster()])),
        refused("Matroska, nested 5,000 deep", matroska(&[nested])),
        harmless("Matroska, index of itself", matroska(&[seek(0x114d_9b74, 0), tracks(), cluster()])),
        harmless("Matroska, index beyond the end", matroska(&[seek(0x1c53_bb6b, u64::MAX >> 1), tracks(), cluster()])),
        refused("Matroska, codec data of 64 PiB", matroska(&[huge(0x1654_ae6b)])),
        harmless("Matroska, attachment of 64 PiB", matroska(&[tracks(), cluster(), huge(0x1941_a469)])),
        refused("Matroska, 100,000 tracks", matroska(&[matroska_tracks(&grey, 100_000)])),
        harmless(
            "Matroska, time scale zero",
            matroska(&[element(0x1549_a966, &element(0x2ad7b1, &[0])), tracks(), cluster()]),
        ),
        harmless(
            "Matroska, time scale 2⁶³",
            matroska(&[element(0x1549_a966, &element(0x2ad7b1, &[0x7f; 8])), tracks(), cluster()]),
        ),
    ]
}

/// AVI and MPEG-TS files that state counts that are too large or contain loops.
fn streams() -> Vec<Attack> {
    let frame = vec![0u8; 8];
    let super_index = chunk("indx", &[le(&[4, 3, u32::from_le_bytes(*b"00dc"), 0, 0, 0]), vec![0xff; 48]].concat());
    let programs: Vec<u8> = (0..2_000u16)
        .flat_map(|i| {
            packet(
                0,
                i as u8,
                &section(0, &[0, 1, 0xc1, 0, 0, (i >> 8) as u8, i as u8, 0xe0 | (i >> 8 & 31) as u8, i as u8]),
            )
        })
        .collect();
    let table_of_itself = packet(0, 0, &section(0, &[0, 1, 0xc1, 0, 0, 0, 1, 0xe0, 0])).repeat(2_000);
    vec![
        refused("AVI, 65,000 streams", avi(b"H264", [320, 240], &[], 65_000, &[])),
        refused("AVI, index of 2³² entries", avi(b"H264", [320, 240], std::slice::from_ref(&frame), 1, &super_index)),
        refused("AVI, no rate, no frame", avi(b"H264", [0, 0], &[], 1, &[])),
        refused("AVI, frames of nothing", avi(b"H264", [320, 240], &vec![vec![]; 100_000], 1, &[])),
        refused("TS, 2,000 programs", programs),
        refused("TS, a table that names itself", table_of_itself),
        refused("TS, nothing but padding", packet(0x1fff, 0, &[]).repeat(20_000)),
    ]
}

/// Formats that are not accepted, and files without a format.
fn others() -> Vec<Attack> {
    vec![
        refused("nothing", ""),
        refused("one byte", "\0"),
        refused("zeros", vec![0; 1 << 20]),
        refused("text", "This is not a video.\n".repeat(1000)),
        refused(
            "raw H.264",
            [&[0, 0, 0, 1][..], &FOREIGN.sps(), &[0, 0, 0, 1], &H264::pps(), &[0, 0, 0, 1], &FOREIGN.key_frame()]
                .concat(),
        ),
        refused("GIF", [b"GIF89a".to_vec(), vec![0xff; 300]].concat()),
        refused("Y4M", format!("YUV4MPEG2 W{} H{} F25:1\nFRAME\n", 1 << 30, 1 << 30)),
        refused("FLV", [b"FLV\x01\x05\0\0\0\x09\0\0\0\0".to_vec(), vec![9; 300]].concat()),
        refused("WAV", [b"RIFF\xff\xff\xff\xffWAVEfmt ".to_vec(), vec![1; 300]].concat()),
        refused("ELF", std::fs::read("/proc/self/exe").unwrap()[..1 << 16].to_vec()),
    ]
}

/// A folder with a secret and another person's recording; the attack files are written there one by one.
struct Scene {
    folder: tempfile::TempDir,
}

impl Scene {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("secret.txt"), SECRET).unwrap();
        std::fs::write(folder.path().join("foreign.mp4"), Movie::of(FOREIGN, 10).bytes()).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn attacks(&self) -> Vec<Attack> {
        let text = |path: PathBuf| path.to_str().unwrap().to_owned();
        let (foreign, secret) = (text(self.path("foreign.mp4")), text(self.path("secret.txt")));
        [playlists(&foreign, &secret), movies(&foreign), pictures(), matroskas(), streams(), others()]
            .into_iter()
            .flatten()
            .collect()
    }
}

/// Describes what is wrong with the end of an attack; `None` if it ended as it may.
fn complaint(attack: &Attack, path: &Path) -> Option<String> {
    let patience = Budget { wall: Duration::from_secs(30), ..budget() };
    let (result, cost) = probe_with(path, &patience);
    let shown = format!("{result:?}");
    eprintln!(
        "| {} | {} B | {} | {:.2} s | {:.2} s CPU | {} MiB |",
        attack.name,
        attack.bytes.len(),
        summary(&result),
        cost.wall.as_secs_f64(),
        cost.cpu.as_secs_f64(),
        cost.peak_rss_bytes >> 20
    );
    let expected = match &result {
        Err(AttemptFailure::Impossible(_)) => true,
        Ok(output) => attack.end == AllowedEnd::Harmless && output.probe.size != Some(FOREIGN_SIZE),
        Err(_) => false,
    };
    let leaked =
        shown.contains(SECRET) || result.is_ok_and(|output| leaks(output.probe.preview.as_deref().unwrap_or_default()));
    (!expected || leaked || cost.peak_rss_bytes > MAX_MEMORY_BYTES)
        .then(|| format!("{}: leaked: {leaked}, {} MiB, {shown}", attack.name, cost.peak_rss_bytes >> 20))
}

fn leaks(bytes: &[u8]) -> bool {
    bytes.windows(SECRET.len()).any(|window| window == SECRET.as_bytes())
}

fn summary(result: &Result<ChildOutput, AttemptFailure>) -> String {
    match result {
        Ok(output) => format!("{} frames", output.probe.times_s.len()),
        Err(AttemptFailure::Impossible(problem)) => problem.slug.clone(),
        Err(other) => format!("{other:?}"),
    }
}

#[test]
fn every_attack_ends_with_a_reason_in_time_and_leaks_nothing() {
    let scene = Scene::new();
    let attacks = scene.attacks();
    assert!(attacks.len() >= 25);
    let path = scene.path("attack.mp4");
    let complaints: Vec<String> = attacks
        .iter()
        .filter_map(|attack| {
            std::fs::write(&path, &attack.bytes).unwrap();
            complaint(attack, &path)
        })
        .collect();
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

#[test]
fn the_bait_is_a_recording_that_can_be_read() {
    let scene = Scene::new();
    let output = probe(&scene.path("foreign.mp4")).0.unwrap();
    assert_eq!((output.probe.size, output.probe.times_s.len()), (Some(FOREIGN_SIZE), 10));
}

#[test]
fn the_largest_accepted_picture_is_decoded_within_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.mp4");
    let grey = H264 { columns: 256, rows: 144, references: 5 }; // the maximum of level 5.1 at this size
    std::fs::write(&path, Movie::of(grey, 30).bytes()).unwrap();
    let (output, cost) = probe(&path);
    let output = output.unwrap();
    assert_eq!((output.probe.size, output.probe.times_s.len()), (Some((4096, 2304)), 30));
    eprintln!("4096×2304: {cost:?}");
}
