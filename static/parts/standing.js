// How a recording stands: how well the tools are seen, whether the server keeps up, what is safe there.
import { html } from './preact.js';
import { bytes, fixed } from '../format.js';
import { t } from '../texts.js';
import { Light, Placed } from './live_view.js';
import { Empty } from './notice.js';
import { behindOf } from './record_view.js';
import { SeenLevel } from './seen_level.js';

const words = t.record;
const CODECS = { h264: 'H.264', jpeg: 'JPEG' };
/** Seconds that nobody notices, and those that somebody should know of. */
const BEHIND_S = { noticed: 0.5, much: 2 };

export const Standing = ({ now, watch }) => html`
  <section class="card">
    <header>
      <h2>${words.tracking}</h2>
      ${now.line === 'open' && html`<${Behind} seconds=${behindOf(now, watch)} />`}
    </header>
    ${watch?.track?.frames ? html`
      <${SeenLevel} watch=${watch} />
      <div class="body"><${Light} watch=${watch} /><${Placed} watch=${watch} /></div>`
    : html`<${Untracked} now=${now} watch=${watch} />`}
  </section>
  <section class="card">
    <header><h2>${words.recording}</h2><${Line} now=${now} /></header>
    <div class="body"><${Facts} now=${now} /></div>
  </section>`;

function Untracked({ now, watch }) {
  if (watch?.why) return html`<${Empty} title=${words.untracked} body=${t.watch.because(watch.why)} />`;
  return html`<${Empty} title=${now.phase === 'sending' ? words.sending : t.watch.begins} body=${words.beginsBody} />`;
}

function Behind({ seconds }) {
  if (Number.isNaN(seconds)) return null;
  const tone = seconds > BEHIND_S.much ? 'warn' : 'good';
  return html`<span class=${`pill ${tone}`}>${seconds < BEHIND_S.noticed ? words.keepsUp
    : words.behind(fixed(seconds, 1))}</span>`;
}

const TONES = { open: 'good', lost: 'bad', refused: 'bad', connecting: '' };

const Line = ({ now: { line = 'connecting' } }) =>
  html`<span class=${`pill ${TONES[line]}`}>${words.line[line] ?? words.line.connecting}</span>`;

function Facts({ now: { picture, codec, rate, frames = 0, kept } }) {
  return html`
    <dl class="facts">
      <dt>${words.frames}</dt><dd>${frames}</dd>
      <dt>${words.safe}</dt><dd>${frames - (kept?.frames ?? 0)}</dd>
      <dt>${words.kept}</dt><dd>${keptWords(kept)}</dd>
      <dt>${words.format}</dt>
      <dd>${picture ? formatOf(picture, codec, rate) : '–'}</dd>
    </dl>`;
}

/** What is on its way to the server at any moment is not worth a number that flickers. */
const keptWords = kept =>
  kept?.seconds >= 1 ? words.keptHere(fixed(kept.seconds, 0), bytes(kept.bytes)) : words.hardlyKept;

const formatOf = ({ width, height }, codec, rate) =>
  [`${width} × ${height}`, CODECS[codec], rate && words.perSecond(fixed(rate, 0))].filter(Boolean).join(', ');
