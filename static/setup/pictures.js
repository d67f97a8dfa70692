// Pictures as the service reads them: JPEG and PNG files as they are, everything else and every frame as a PNG, which
// changes no pixel.
import { Problem } from '../api.js';
import { t } from '../texts.js';

const ACCEPTED_TYPES = ['image/jpeg', 'image/png'];

/** A chosen file as `{ blob, name }`. */
export async function pictureOf(file) {
  if (ACCEPTED_TYPES.includes(file.type)) return { blob: file, name: file.name };
  const drawable = await createImageBitmap(file).catch(() => null);
  if (!drawable) throw new Problem({ title: t.setup.notAPicture(file.name), status: 0, detail: t.setup.notAPictureBody });
  const blob = await toPng(drawable, drawable.width, drawable.height);
  drawable.close();
  return { blob, name: file.name.replace(/\.[^.]*$/, '.png') };
}

/** The current picture of a video, at the size that it is stored with: the tracker measures stored pixels. */
export function frameOf(video) {
  const { width, height } = storedSize(video);
  return toPng(video, width, height);
}

/** A video element states the size at which it shows pictures. Pixels that are not square have another one. */
function storedSize(video) {
  const shown = { width: video.videoWidth, height: video.videoHeight };
  try {
    const frame = new VideoFrame(video);
    const stored = frame.visibleRect ?? shown;
    frame.close();
    // Stretching changes one side; a picture that is turned by a quarter has its sides exchanged.
    if (stored.width === shown.width || stored.height === shown.height) return stored;
    if (stored.width === shown.height || stored.height === shown.width) return { width: stored.height, height: stored.width };
  } catch {
    // This browser has no such frames, or the video comes from a source that scripts may not read.
  }
  return shown;
}

async function toPng(drawable, width, height) {
  const canvas = new OffscreenCanvas(width, height);
  canvas.getContext('2d')?.drawImage(drawable, 0, 0, width, height);
  return canvas.convertToBlob({ type: 'image/png' });
}

/** A blob for display: address, width and height. The owner calls `URL.revokeObjectURL` in the end. */
export async function displayable(blob) {
  const bitmap = await createImageBitmap(blob).catch(() => null);
  const size = bitmap && { width: bitmap.width, height: bitmap.height };
  bitmap?.close();
  return { url: URL.createObjectURL(blob), ...size };
}
