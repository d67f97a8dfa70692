// Pictures as the service reads them: JPEG or PNG files as they are, everything else and every frame drawn into a PNG, which
// changes no pixel.
import { Problem } from '../api.js';
import { t } from '../texts.js';

const READ_AS_THEY_ARE = ['image/jpeg', 'image/png'];

/** A chosen file as `{ blob, name }`. */
export async function pictureOf(file) {
  if (READ_AS_THEY_ARE.includes(file.type)) return { blob: file, name: file.name };
  const drawable = await createImageBitmap(file).catch(() => null);
  if (!drawable) throw new Problem({ title: t.setup.notAPicture(file.name), status: 0, detail: t.setup.notAPictureBody });
  const blob = await drawn(drawable, drawable.width, drawable.height);
  drawable.close();
  return { blob, name: file.name.replace(/\.[^.]*$/, '.png') };
}

/** What a video shows now, at its own size. */
export const frameOf = video => drawn(video, video.videoWidth, video.videoHeight);

async function drawn(drawable, width, height) {
  const canvas = new OffscreenCanvas(width, height);
  canvas.getContext('2d').drawImage(drawable, 0, 0, width, height);
  return canvas.convertToBlob({ type: 'image/png' });
}

/** A blob to look at: address, width and height. Whoever takes it away calls `URL.revokeObjectURL`. */
export async function shown(blob) {
  const bitmap = await createImageBitmap(blob).catch(() => null);
  const size = bitmap && { width: bitmap.width, height: bitmap.height };
  bitmap?.close();
  return { url: URL.createObjectURL(blob), ...size };
}
