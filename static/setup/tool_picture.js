// What to measure on an instrument: with tape its diameter and the length of the band, without tape the diameter of the
// tube, its collar and its jaws.
import { html } from '../preact.js';
import { t } from '../texts.js';

const words = t.setup.tools;

export const ToolPicture = () => html`
  <svg class="tool-picture" viewBox="0 0 440 190" role="img" aria-label=${words.picture}>
    <rect class="tube" x="10" y="80" width="280" height="30" />
    <path class="jaw" d="M300 82h20l70-16q14-2 16 8l-70 16h-36zM300 108h20l70 16q14 2 16-8l-70-16h-36z" />
    <rect class="tape" x="180" y="77" width="120" height="36" />
    <g class="measure">
      <path d="M180 140v18M300 140v18M184 149h112M190 144l-7 5 7 5M290 144l7 5-7 5" />
      <path d="M70 40v34M70 116v34M64 66l6 8 6-8M64 124l6-8 6 8M56 77h124M56 113h124" />
    </g>
    <text x="240" y="178" text-anchor="middle">${words.bandShort}</text>
    <text x="70" y="30" text-anchor="middle">${words.diameterShort}</text>
    <text x="240" y="66" text-anchor="middle">${words.tapeShort}</text>
    <text x="345" y="52" text-anchor="middle">${words.tipShort}</text>
  </svg>`;

export const BareToolPicture = () => html`
  <svg class="tool-picture" viewBox="0 0 440 200" role="img" aria-label=${words.bare.picture}>
    <rect class="tube" x="10" y="80" width="240" height="30" />
    <rect class="jaw" x="250" y="84" width="40" height="22" />
    <path class="jaw" d="M294 86h20l108 7q4 2 0 4l-108 7h-20z" />
    <g class="measure">
      <path d="M70 40v37M70 113v37M64 69l6 8 6-8M64 121l6-8 6 8M56 80h28M56 110h28" />
      <path d="M250 118v20M290 118v20M254 128h32M260 123l-6 5 6 5M280 123l6 5-6 5" />
      <path d="M250 150v20M424 118v52M254 160h166M260 155l-6 5 6 5M414 155l6 5-6 5" />
    </g>
    <text x="70" y="30" text-anchor="middle">${words.diameterShort}</text>
    <text x="242" y="133" text-anchor="end">${words.bare.collarShort}</text>
    <text x="337" y="188" text-anchor="middle">${words.bare.jawShort}</text>
  </svg>`;
