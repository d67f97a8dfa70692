// A picture that a person chose as the logo, made small enough for every page.
import { Problem } from '../../api.js';
import { t } from '../../texts.js';

/** Largest side, pixels: sharp on a printed certificate, and light for a phone. */
const MAX_SIDE_PX = 640;
/** The service refuses larger files, bytes. */
const MAX_BYTES = 512 * 1024;
const JPEG_QUALITY = 0.9;

/**
 * The picture as a file that the service takes. It is drawn anew, so that what a camera or an editor has hidden in it
 * (place, author, thumbnail) does not become public. Throws a problem if it is no picture.
 *
 * @param {File} file
 * @returns {Promise<Blob>}
 */
export async function logoPicture(file) {
  const unreadable = new Problem({ title: t.centre.noPicture, detail: t.centre.noPictureBody, status: 0 });
  if (!['image/png', 'image/jpeg'].includes(file.type)) throw unreadable;
  const bitmap = await createImageBitmap(file).catch(() => Promise.reject(unreadable));
  const scale = Math.min(1, MAX_SIDE_PX / Math.max(bitmap.width, bitmap.height));
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [bitmap.width, bitmap.height].map(side => Math.max(1, Math.round(side * scale)));
  const context = canvas.getContext('2d');
  if (!context) throw unreadable;
  context.imageSmoothingQuality = 'high';
  context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  bitmap.close();
  const png = await encoded(canvas, 'image/png');
  if (png && png.size <= MAX_BYTES) return png;
  const jpeg = await encoded(canvas, 'image/jpeg'); // A photo is smaller so; it has no transparent parts.
  if (jpeg && jpeg.size <= MAX_BYTES) return jpeg;
  throw unreadable;
}

/** @param {HTMLCanvasElement} canvas @param {string} type @returns {Promise<Blob | null>} */
const encoded = (canvas, type) => new Promise(done => canvas.toBlob(done, type, JPEG_QUALITY));
