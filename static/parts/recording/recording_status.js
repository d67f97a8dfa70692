// The state of a recording: how well the tools are seen, whether the server keeps up, how much is safe there.
import { html } from '../../preact.js';
import { bytes, fixed } from '../../format.js';
import { t } from '../../texts.js';
import { LearningBox, LightState, PlacementState } from '../live/live_view.js';
import { Empty } from '../page/notice.js';
import { delayOf } from './record_view.js';
import { SeenLevel } from '../live/seen_level.js';

const words = t.record;
const CODECS = { h264: 'H.264', jpeg: 'JPEG' };
/** Delays that begin to be noticed, and delays that a person should know of, s. */
const DELAY_S = { noticed: 0.5, much: 2 };

/** @param {Props} props */
export const RecordingStatus = ({ recording, watch }) => html`
  <section class="card">
    <header>
      <h2>${words.tracking}</h2>
      ${recording.connection === 'open' && html`<${DelayPill} seconds=${delayOf(recording, watch)} />`}
    </header>
    ${watch?.track?.frames ? html`
      <${SeenLevel} watch=${watch} />
      <div class="body">
        <${LightState} watch=${watch} /><${PlacementState} watch=${watch} /><${LearningBox} watch=${watch} />
      </div>`
    : recording.exam ? html`<${Empty} title=${t.exams.sealed} body=${t.exams.noFigures} />`
    : html`<${Untracked} recording=${recording} watch=${watch} />`}
  </section>
  <section class="card">
    <header><h2>${words.recording}</h2><${ConnectionPill} recording=${recording} /></header>
    <div class="body"><${Facts} recording=${recording} /></div>
  </section>`;

/** @param {Props} props */
function Untracked({ recording, watch }) {
  if (watch?.why) return html`<${Empty} title=${words.untracked} body=${t.watch.because(watch.why)} />`;
  return html`<${Empty} title=${recording.phase === 'sending' ? words.sending : t.watch.begins} body=${words.beginsBody} />`;
}

function DelayPill({ seconds }) {
  if (Number.isNaN(seconds)) return null;
  const tone = seconds > DELAY_S.much ? 'warn' : 'good';
  return html`<span class=${`pill ${tone}`}>${seconds < DELAY_S.noticed ? words.keepsUp
    : words.behind(fixed(seconds, 1))}</span>`;
}

const TONES = { open: 'good', lost: 'bad', refused: 'bad', connecting: '' };

const ConnectionPill = ({ recording: { connection = 'connecting' } }) =>
  html`<span class=${`pill ${TONES[connection]}`}>${words.line[connection] ?? words.line.connecting}</span>`;

function Facts({ recording: { picture, codec, rate, frames = 0, kept } }) {
  return html`
    <dl class="facts">
      <dt>${words.frames}</dt><dd>${frames}</dd>
      <dt>${words.safe}</dt><dd>${frames - (kept?.frames ?? 0)}</dd>
      <dt>${words.kept}</dt><dd>${keptText(kept)}</dd>
      <dt>${words.format}</dt>
      <dd>${picture ? formatOf(picture, codec, rate) : '–'}</dd>
    </dl>`;
}

/** The small amount that is always on its way to the server is not shown: the number would flicker. */
const keptText = kept =>
  kept?.seconds >= 1 ? words.keptHere(fixed(kept.seconds, 0), bytes(kept.bytes)) : words.hardlyKept;

const formatOf = ({ width, height }, codec, rate) =>
  [`${width} × ${height}`, CODECS[codec], rate && words.perSecond(fixed(rate, 0))].filter(Boolean).join(', ');
