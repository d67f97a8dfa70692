// A text as a QR code: dark on light in both themes, with the margin that readers need.
import { html } from '../preact.js';
import { qrcode } from '../vendor/qrcode-generator/qrcode.mjs';

const MARGIN = 4;

export function QrCode({ text, name }) {
  const code = qrcode(0, 'M'); // As large as the text needs; it tolerates a smear.
  code.addData(text);
  code.make();
  const count = code.getModuleCount();
  const size = count + 2 * MARGIN;
  const path = [];
  for (let row = 0; row < count; row++)
    for (let column = 0; column < count; column++)
      if (code.isDark(row, column)) path.push(`M${column + MARGIN} ${row + MARGIN}h1v1h-1z`);
  return html`
    <svg class="qr" viewBox=${`0 0 ${size} ${size}`} role="img" aria-label=${name} shape-rendering="crispEdges">
      <rect width=${size} height=${size} fill="#fff" />
      <path d=${path.join('')} fill="#000" />
    </svg>`;
}
