// The codec of a recording: H.264 if the browser can encode it, else JPEG.

/** Bits a second at 1080p and 30 frames a second: the edges of the tapes must stay where they are. */
const BIT_RATE = 6e6;
const MIN_BIT_RATE = 1.5e6;
const REFERENCE = { pixels: 1920 * 1080, rate: 30 };
/** High, Main and Constrained Baseline; the level is that of 1080p at 60 frames a second. */
const PROFILES = ['avc1.64002a', 'avc1.4d002a', 'avc1.42e02a'];

/** The settings of a `VideoEncoder`, or null if frames are sent as JPEGs. */
export async function h264For({ width, height, frameRate }) {
  if (!('VideoEncoder' in globalThis) || width % 2 || height % 2) return null;
  // Small pictures need more bits per pixel.
  const share = ((width * height) / REFERENCE.pixels) ** 0.75 * (frameRate / REFERENCE.rate);
  for (const codec of PROFILES) {
    /** @type {VideoEncoderConfig} */
    const config = {
      codec,
      width,
      height,
      framerate: frameRate,
      bitrate: Math.round(Math.max(MIN_BIT_RATE, BIT_RATE * share)),
      latencyMode: 'realtime',
      avc: { format: 'annexb' },
    };
    const answer = await VideoEncoder.isConfigSupported(config).catch(() => null);
    if (answer?.supported && answer.config?.avc?.format === 'annexb') return config;
  }
  return null;
}
