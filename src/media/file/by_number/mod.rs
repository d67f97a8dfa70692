//! Decodes a few frames of a recording by number, without decoding everything before them.
//!
//! The packets' time stamps say which frame is the n-th. Decoding begins at the last key frame before each requested
//! frame, and skips frames that no other frame refers to. In an undamaged recording, the pictures are the same as those
//! of [`VideoFile::next_picture`]. In a damaged one, a picture depends on the frames decoded before it, and some
//! packets may give no frame. A caller that must be sure has to compare when the whole recording is decoded.

use std::collections::{BTreeMap, BTreeSet};

use ff::Rescale;
use ffmpeg_next as ff;

use super::{Picture, VideoFile, is_before};
use crate::media::annexb::is_hidden;

/// Packets read beyond the last requested frame, as earlier frames may be stored after it: more than any codec reorders
/// (H.264 and H.265: 16).
const MAX_REORDERED: u64 = 32;

/// Requested frames that depend on one key frame: their stamps and numbers.
type Wanted = BTreeMap<i64, u64>;

/// A frame's packet.
struct ListedPacket {
    pts: i64,
    dts: i64,
    is_key: bool,
}

impl VideoFile {
    /// Calls `show` with the frames of these numbers, in order, each with its number as index; times are meaningless.
    /// Returns `None`, perhaps after some frames, if the packets do not identify them; then decode from the start.
    pub fn show_frames(mut self, numbers: &[u64], show: impl FnMut(&Picture)) -> Option<()> {
        let last = *numbers.iter().max().filter(|&&last| last < self.limits.frames)?;
        let listed = self.list_packets(last, &mut || ())?;
        self.show_listed(&listed, numbers, show, &mut || ())
    }

    /// Calls `show` with at most `most` frames that are spread over the whole recording, as [`Self::show_frames`] does.
    /// Key frames are preferred, because they are decoded alone; neighbours are at most twice as far apart as if all
    /// were evenly spread. Calls `on_packet` for each packet read: `show` may not be called for minutes.
    pub fn show_spread(mut self, most: usize, show: impl FnMut(&Picture), mut on_packet: impl FnMut()) -> Option<()> {
        let listed = self.list_packets(self.limits.frames, &mut on_packet)?;
        if listed.len() as u64 > self.limits.frames {
            return None;
        }
        self.show_listed(&listed, &spread_over(&listed, most), show, &mut on_packet)
    }

    fn show_listed(
        mut self,
        listed: &[ListedPacket],
        numbers: &[u64],
        mut show: impl FnMut(&Picture),
        on_packet: &mut impl FnMut(),
    ) -> Option<()> {
        let mut groups: BTreeMap<usize, Wanted> = BTreeMap::new();
        for &number in numbers {
            let place = usize::try_from(number).ok().filter(|&place| place < listed.len())?;
            let key = listed[..=place].iter().rposition(|packet| packet.is_key)?;
            groups.entry(key).or_default().insert(listed[place].pts, number);
        }
        for (key, wanted) in groups {
            self.seek_to_key(&listed[key])?;
            let mut to_feed: BTreeSet<i64> = wanted.keys().copied().collect();
            for (&pts, &number) in &wanted {
                let video = self.frame_at(pts, &wanted, &mut to_feed, on_packet)?;
                self.decoded = number;
                let picture = self.picture(video).ok()?;
                show(&picture);
                self.recycle(picture);
            }
        }
        Some(())
    }

    /// The packets of the frames up to this one and a few more, in presentation order; `None` unless each has a
    /// distinct stamp and the first begins the recording.
    fn list_packets(&mut self, last: u64, on_packet: &mut impl FnMut()) -> Option<Vec<ListedPacket>> {
        let enough = last.saturating_add(MAX_REORDERED);
        let mut listed = Vec::new();
        while listed.len() as u64 <= enough
            && let Some(packet) = self.read_packet()
        {
            on_packet();
            if packet.stream() == self.stream {
                let is_shown = !is_hidden(&packet) && !is_before(packet.pts(), self.first_shown);
                let is_usable = !packet.is_corrupt() && is_shown;
                let (pts, dts) = packet.pts().zip(packet.dts()).filter(|_| is_usable)?;
                listed.push(ListedPacket { pts, dts, is_key: packet.is_key() });
            }
        }
        let first_pts = listed.first().filter(|first| first.is_key)?.pts;
        listed.sort_by_key(|packet| packet.pts);
        let is_distinct = listed.windows(2).all(|pair| pair[0].pts < pair[1].pts);
        (is_distinct && listed[0].pts == first_pts).then_some(listed)
    }

    /// Seeks to a key frame, or to one before it. Some containers seek by presentation stamp, some by decoding stamp,
    /// and both may miss; a packet that is no key frame must not be decoded as if it were one.
    fn seek_to_key(&mut self, key: &ListedPacket) -> Option<()> {
        let time_base = self.input.stream(self.stream)?.time_base();
        for stamp in [key.pts, key.dts] {
            let time = stamp.rescale(time_base, ff::rescale::TIME_BASE);
            if self.input.seek(time, ..time).is_err() {
                continue;
            }
            let stream = self.stream;
            let first = std::iter::from_fn(|| self.read_packet()).find(|packet| packet.stream() == stream);
            if let Some(packet) = first
                && packet.is_key()
                && packet.pts().is_some_and(|pts| pts <= key.pts)
            {
                self.decoder.flush();
                (self.pending, self.drained) = (Some(packet), false);
                return Some(());
            }
        }
        None
    }

    /// Decodes up to the frame of this stamp. When all requested packets have been sent, the decoder is drained:
    /// otherwise it would hold frames back to order them.
    fn frame_at(
        &mut self,
        pts: i64,
        wanted: &Wanted,
        to_feed: &mut BTreeSet<i64>,
        on_packet: &mut impl FnMut(),
    ) -> Option<ff::frame::Video> {
        let mut video = self.maker.frame_to_fill();
        for _ in 0..self.limits.frames.saturating_mul(2) {
            match self.decoder.receive_frame(&mut video) {
                Ok(()) if video.pts() == Some(pts) => return Some(video),
                Ok(()) if video.pts().is_none_or(|passed| passed > pts) => return None,
                Ok(()) => {}
                Err(_) if self.drained => return None,
                Err(_) if to_feed.is_empty() => self.send(None),
                Err(_) => {
                    on_packet();
                    self.feed_towards(wanted, to_feed)?;
                }
            }
        }
        None
    }

    /// Sends the decoder one more packet; a frame that is not requested is decoded only if another may refer to it.
    fn feed_towards(&mut self, wanted: &Wanted, to_feed: &mut BTreeSet<i64>) -> Option<()> {
        let packet = self.next_packet()?;
        let pts = packet.pts().filter(|pts| packet.stream() == self.stream && wanted.contains_key(pts));
        self.decoder.skip_frame(if pts.is_some() { ff::Discard::Default } else { ff::Discard::NonReference });
        self.send(Some(packet));
        if self.pending.is_none()
            && let Some(pts) = pts
        {
            to_feed.remove(&pts);
        }
        Some(())
    }
}

/// Numbers of at most `most` frames: evenly spread ones, or the last key frame since the one before.
fn spread_over(listed: &[ListedPacket], most: usize) -> Vec<u64> {
    let count = most.min(listed.len());
    let mut from = 0;
    let spread = (0..count).map(|i| {
        let even = i * (listed.len() - 1) / (count.max(2) - 1);
        let key = listed[from..=even].iter().rposition(|packet| packet.is_key);
        let number = key.map_or(even, |place| from + place);
        from = even + 1;
        number as u64
    });
    spread.collect()
}

#[cfg(test)]
mod tests;
