//! Bytes of H.264, MP4, Matroska, AVI and MPEG-TS, assembled by hand: files that no encoder would write.

/// Writes bits, most significant first.
#[derive(Default)]
pub struct Bits {
    bytes: Vec<u8>,
    free: u8,
}

impl Bits {
    /// The `count` lowest bits of `value`.
    pub fn put(&mut self, value: u64, count: u8) -> &mut Self {
        for i in (0..count).rev() {
            if self.free == 0 {
                self.bytes.push(0);
                self.free = 8;
            }
            self.free -= 1;
            let bit = (value >> i & 1) as u8;
            *self.bytes.last_mut().unwrap() |= bit << self.free;
        }
        self
    }

    /// An unsigned Exp-Golomb code.
    pub fn ue(&mut self, value: u64) -> &mut Self {
        let length = (value + 1).ilog2() as u8;
        self.put(0, length).put(value + 1, length + 1)
    }

    /// A NAL unit: header, these bits, stop bit, emulation prevention.
    fn nal(&mut self, header: u8) -> Vec<u8> {
        self.put(1, 1);
        let mut out = vec![header];
        let mut zeros = 0;
        for &byte in &self.bytes {
            if zeros >= 2 && byte <= 3 {
                out.push(3);
                zeros = 0;
            }
            zeros = if byte == 0 { zeros + 1 } else { 0 };
            out.push(byte);
        }
        out
    }
}

/// An H.264 stream of grey pictures, each macroblock one byte: any size for little effort.
pub struct H264 {
    /// Width, macroblocks of 16 pixels.
    pub columns: u64,
    /// Height, macroblocks.
    pub rows: u64,
    /// Reference frames that the stream asks the decoder to keep.
    pub references: u64,
}

impl H264 {
    pub fn sps(&self) -> Vec<u8> {
        let mut bits = Bits::default();
        bits.put(66, 8).put(0xc0, 8).put(62, 8).ue(0).ue(0).ue(2).ue(self.references).put(0, 1);
        bits.ue(self.columns - 1).ue(self.rows - 1).put(0b1100, 4).nal(0x67)
    }

    pub fn pps() -> Vec<u8> {
        let mut bits = Bits::default();
        bits.ue(0).ue(0).put(0, 2).ue(0).ue(0).ue(0).put(0, 3).ue(0).ue(0).ue(0).put(0b100, 3).nal(0x68)
    }

    /// A picture that depends on no other picture.
    pub fn key_frame(&self) -> Vec<u8> {
        let mut bits = Bits::default();
        bits.ue(0).ue(7).ue(0).put(0, 4).ue(0).put(0, 2).ue(0).ue(1);
        for _ in 0..self.columns * self.rows {
            bits.put(0b0010_0111, 8); // intra 16×16 DC, no residual
        }
        bits.nal(0x65)
    }

    /// A repetition of the picture before.
    pub fn repeat_frame(&self, number: u64) -> Vec<u8> {
        let mut bits = Bits::default();
        bits.ue(0).ue(5).ue(0).put(number % 16, 4).put(0, 3).ue(0).ue(1);
        bits.ue(self.columns * self.rows).nal(0x41)
    }

    /// The decoder configuration, as in an MP4's `avcC`.
    pub fn configuration(&self) -> Vec<u8> {
        let (sps, pps) = (self.sps(), Self::pps());
        let mut out = vec![1, sps[1], sps[2], sps[3], 0xff, 0xe1];
        out.extend((sps.len() as u16).to_be_bytes());
        out.extend(sps);
        out.push(1);
        out.extend((pps.len() as u16).to_be_bytes());
        out.extend(pps);
        out
    }

    /// A key frame and repetitions, each as a sample of an MP4 or a Matroska block.
    pub fn samples(&self, count: u64) -> Vec<Vec<u8>> {
        let frame = |i| if i == 0 { self.key_frame() } else { self.repeat_frame(i) };
        (0..count).map(|i| sized(&frame(i))).collect()
    }
}

/// A NAL unit after its length.
pub fn sized(nal: &[u8]) -> Vec<u8> {
    [&(nal.len() as u32).to_be_bytes()[..], nal].concat()
}

/// An MP4 box.
pub fn atom(name: &str, content: &[u8]) -> Vec<u8> {
    [&(content.len() as u32 + 8).to_be_bytes()[..], name.as_bytes(), content].concat()
}

/// A box with version 0 and flags 0.
pub fn full(name: &str, content: &[u8]) -> Vec<u8> {
    atom(name, &[&[0; 4], content].concat())
}

/// Numbers of 32 bits, big-endian.
pub fn be(numbers: &[u32]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_be_bytes()).collect()
}

/// An MP4 with one video track. Each part can be replaced by a damaged one.
pub struct Movie {
    pub timescale: u32,
    pub duration: u32,
    pub stated_size: [u16; 2],
    pub configuration: Vec<u8>,
    pub samples: Vec<Vec<u8>>,
    /// The data reference; in a valid file it refers to the file itself.
    pub dref: Vec<u8>,
    /// Replaces the valid `stts`.
    pub stts: Option<Vec<u8>>,
    /// Replaces the valid `stsz`.
    pub stsz: Option<Vec<u8>>,
    /// Boxes between `tkhd` and `mdia`.
    pub edits: Vec<u8>,
    /// Number of copies of the track.
    pub tracks: usize,
}

impl Movie {
    /// Two seconds of grey, 320×240, undamaged.
    pub fn valid() -> Self {
        let grey = H264 { columns: 20, rows: 15, references: 1 };
        Self {
            timescale: 25,
            duration: 50,
            stated_size: [320, 240],
            configuration: grey.configuration(),
            samples: grey.samples(50),
            dref: full("url ", &[]).iter().enumerate().map(|(i, &b)| if i == 11 { 1 } else { b }).collect(),
            stts: None,
            stsz: None,
            edits: Vec::new(),
            tracks: 1,
        }
    }

    /// Grey of another size.
    pub fn of(grey: H264, frames: u64) -> Self {
        Self { configuration: grey.configuration(), samples: grey.samples(frames), ..Self::valid() }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mdat = atom("mdat", &self.samples.concat());
        let ftyp = atom("ftyp", b"isom\0\0\0\x01isomavc1");
        let data_at = ftyp.len() as u32 + 8;
        [ftyp, mdat, self.moov(data_at)].concat()
    }

    pub fn moov(&self, data_at: u32) -> Vec<u8> {
        let mut mvhd = be(&[0, 0, self.timescale, self.duration, 0x10000, 0x1000000, 0, 0]);
        mvhd.extend(be(&[0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x4000_0000, 0, 0, 0, 0, 0, 0, 2]));
        let traks = self.trak(data_at).repeat(self.tracks);
        atom("moov", &[full("mvhd", &mvhd), traks].concat())
    }

    fn trak(&self, data_at: u32) -> Vec<u8> {
        let [width, height] = self.stated_size.map(|n| u32::from(n) << 16);
        let mut tkhd = be(&[0, 0, 1, 0, self.duration, 0, 0, 0, 0]);
        tkhd.extend(be(&[0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x4000_0000, width, height]));
        let mdhd = full("mdhd", &be(&[0, 0, self.timescale, self.duration, 0x55c4_0000]));
        let hdlr = full("hdlr", &[&be(&[0])[..], b"vide", &[0; 13]].concat());
        let dinf = atom("dinf", &full("dref", &[be(&[1]), self.dref.clone()].concat()));
        let minf = atom("minf", &[full("vmhd", &[0; 8]), dinf, self.stbl(data_at)].concat());
        let mdia = atom("mdia", &[mdhd, hdlr, minf].concat());
        atom("trak", &[full("tkhd", &tkhd), self.edits.clone(), mdia].concat())
    }

    fn stbl(&self, data_at: u32) -> Vec<u8> {
        let count = self.samples.len() as u32;
        let sizes: Vec<u32> = self.samples.iter().map(|s| s.len() as u32).collect();
        let valid_stts = full("stts", &be(&[1, count, 1]));
        let valid_stsz = full("stsz", &[be(&[0, count]), be(&sizes)].concat());
        let parts = [
            full("stsd", &[be(&[1]), self.sample_entry()].concat()),
            self.stts.clone().unwrap_or(valid_stts),
            full("stsc", &be(&[1, 1, count.max(1), 1])),
            self.stsz.clone().unwrap_or(valid_stsz),
            full("stco", &be(&[1, data_at])),
        ];
        atom("stbl", &parts.concat())
    }

    fn sample_entry(&self) -> Vec<u8> {
        let mut entry = be(&[0, 1, 0, 0, 0, 0]);
        entry.extend(self.stated_size.iter().flat_map(|n| n.to_be_bytes()));
        entry.extend(be(&[0x48_0000, 0x48_0000, 0]));
        entry.extend([0, 1]);
        entry.extend([0; 32]);
        entry.extend([0, 24, 255, 255]);
        entry.extend(atom("avcC", &self.configuration));
        atom("avc1", &entry)
    }
}

/// An EBML element with an eight-byte length.
pub fn element(id: u32, content: &[u8]) -> Vec<u8> {
    element_of_length(id, content.len() as u64, content)
}

/// An EBML element that states this length, which may be wrong.
pub fn element_of_length(id: u32, length: u64, content: &[u8]) -> Vec<u8> {
    let id: Vec<u8> = id.to_be_bytes().into_iter().skip_while(|&b| b == 0).collect();
    let length = (length | 1 << 56).to_be_bytes();
    [&id[..], &length[..], content].concat()
}

/// A Matroska file: these elements inside its segment.
pub fn matroska(inside: &[Vec<u8>]) -> Vec<u8> {
    let head = element(0x1a45_dfa3, &element(0x4282, b"matroska"));
    [head, element(0x1853_8067, &inside.concat())].concat()
}

/// Matroska's description of one H.264 track.
pub fn matroska_tracks(grey: &H264, count: usize) -> Vec<u8> {
    let entry = |number: u8| {
        let video = element(0xe0, &[element(0xb0, &[1, 64]), element(0xba, &[0, 240])].concat());
        let parts = [
            element(0xd7, &[number]),
            element(0x73c5, &[number]),
            element(0x83, &[1]),
            element(0x86, b"V_MPEG4/ISO/AVC"),
            element(0x63a2, &grey.configuration()),
            video,
        ];
        element(0xae, &parts.concat())
    };
    element(0x1654_ae6b, &(0..count).flat_map(|i| entry((i % 126 + 1) as u8)).collect::<Vec<u8>>())
}

/// One Matroska cluster of key blocks of track 1, 40 ms apart.
pub fn matroska_cluster(samples: &[Vec<u8>]) -> Vec<u8> {
    let block = |(i, sample): (usize, &Vec<u8>)| {
        let at = (i as i16 * 40).to_be_bytes();
        element(0xa3, &[&[0x81, at[0], at[1], 0x80], &sample[..]].concat())
    };
    let blocks: Vec<u8> = samples.iter().enumerate().flat_map(block).collect();
    element(0x1f43_b675, &[element(0xe7, &[0]), blocks].concat())
}

/// A RIFF chunk.
pub fn chunk(name: &str, content: &[u8]) -> Vec<u8> {
    let padding = &[0u8][..content.len() % 2];
    [name.as_bytes(), &(content.len() as u32).to_le_bytes(), content, padding].concat()
}

/// A RIFF list.
pub fn list(kind: &str, content: &[u8]) -> Vec<u8> {
    chunk("LIST", &[kind.as_bytes(), content].concat())
}

/// Numbers of 32 bits, little-endian.
pub fn le(numbers: &[u32]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
}

/// An AVI of these frames in this codec, with `streams` equal headers; `more` is added to each header.
pub fn avi(codec: &[u8; 4], size: [u32; 2], frames: &[Vec<u8>], streams: usize, more: &[u8]) -> Vec<u8> {
    let avih = le(&[40_000, 0, 0, 0, frames.len() as u32, 0, streams as u32, 0, size[0], size[1], 0, 0, 0, 0]);
    let codec_number = u32::from_le_bytes(*codec);
    let strh =
        [b"vids".to_vec(), codec.to_vec(), le(&[0, 0, 0, 1, 25, 0, frames.len() as u32, 0, 0, 0, 0, 0])].concat();
    let strf = le(&[40, size[0], size[1], 0x18_0001, codec_number, 0, 0, 0, 0, 0]);
    let strl = list("strl", &[chunk("strh", &strh), chunk("strf", &strf), more.to_vec()].concat());
    let hdrl = list("hdrl", &[chunk("avih", &avih), strl.repeat(streams)].concat());
    let movi = list("movi", &frames.iter().flat_map(|f| chunk("00dc", f)).collect::<Vec<u8>>());
    chunk("RIFF", &[b"AVI ".to_vec(), hdrl, movi].concat())
}

/// A transport stream packet that begins a section or stream.
pub fn packet(pid: u16, counter: u8, payload: &[u8]) -> Vec<u8> {
    let [high, low] = pid.to_be_bytes();
    let mut out = vec![0x47, 0x40 | high, low, 0x10 | counter & 15];
    out.extend_from_slice(&payload[..payload.len().min(184)]);
    out.resize(188, 0xff);
    out
}

/// A section of program specific information, after its pointer, with its checksum.
pub fn section(table: u8, body: &[u8]) -> Vec<u8> {
    let length = (body.len() + 4) as u16 | 0xb000;
    let mut out = [&[table][..], &length.to_be_bytes(), body].concat();
    let crc = crc32(&out);
    out.extend(crc.to_be_bytes());
    out.insert(0, 0);
    out
}

fn crc32(bytes: &[u8]) -> u32 {
    bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(
            crc ^ u32::from(byte) << 24,
            |crc, _| {
                if crc >> 31 == 1 { crc << 1 ^ 0x04c1_1db7 } else { crc << 1 }
            },
        )
    })
}
