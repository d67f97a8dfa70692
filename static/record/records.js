// The records of a feed as bytes, protocol 1 of docs/feed.md. Numbers are big-endian.

/** Ticks a second: the clock of MPEG. All usual frame durations are whole numbers of its ticks. */
export const TICKS_PER_S = 90_000;
/** Largest frame, bytes. */
export const MAX_PAYLOAD = 1 << 20;

const HEAD = 32;
const FRAME = 1;
const GAP = 2;
/** The reason of a gap: the sender's memory was full and its oldest part was dropped. */
const SPOOL_FULL = 2;

const TABLE = Uint32Array.from({ length: 256 }, (_, n) => {
  for (let bit = 0; bit < 8; bit++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});

/** CRC-32 as in PNG and zlib. */
function crc32(...parts) {
  let sum = 0xffffffff;
  for (const part of parts) for (let i = 0; i < part.length; i++) sum = TABLE[(sum ^ part[i]) & 255] ^ (sum >>> 8);
  return ~sum >>> 0;
}

/** A frame `{ number, time, isKey, payload }`; time in ticks since the recording began. */
export function frameRecord(epoch, { number, time, isKey, payload }) {
  return record({ kind: FRAME, flags: isKey ? 1 : 0, epoch, number, time, payload });
}

/** Frames that will never come. */
export function gapRecord(epoch, [number, last]) {
  const payload = new Uint8Array(9);
  new DataView(payload.buffer).setBigUint64(0, BigInt(last));
  payload[8] = SPOOL_FULL;
  return record({ kind: GAP, flags: 0, epoch, number, time: 0, payload });
}

function record({ kind, flags, epoch, number, time, payload }) {
  const bytes = new Uint8Array(HEAD + payload.length);
  bytes.set(payload, HEAD);
  const head = new DataView(bytes.buffer);
  head.setUint8(0, kind);
  head.setUint8(1, flags);
  head.setUint32(4, epoch);
  head.setBigUint64(8, BigInt(number));
  head.setBigInt64(16, BigInt(time));
  head.setUint32(24, payload.length);
  head.setUint32(28, crc32(bytes.subarray(0, 28), payload));
  return bytes;
}
