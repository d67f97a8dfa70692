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

/** The current picture of a video, at its own size. */
export const frameOf = video => toPng(video, video.videoWidth, video.videoHeight);

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
