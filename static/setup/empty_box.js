// The picture of the empty box, for instruments without tape: a file, a moment of a clip, or a photo of the camera.
import { html } from '../preact.js';
import { asProblem } from '../data.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { focusSoon } from '../parts/forms/focus.js';
import { Notice } from '../parts/page/notice.js';
import { readPicture } from './frames.js';
import { isBare } from './marks.js';

const words = t.setup.colours.empty;
const HEADING = 'empty-box';

/** Takes a chosen file or a blob as the picture. Calls back with the problem if it is not a picture. */
export async function takeEmptyBox(draft, picture, onProblem) {
  try {
    setEmptyBox(draft, await readPicture(picture));
  } catch (error) {
    onProblem(asProblem(error));
  }
}

function setEmptyBox(draft, emptyBox) {
  if (draft.emptyBox) URL.revokeObjectURL(draft.emptyBox.url);
  draft.emptyBox = emptyBox;
  draft.notify();
}

/** The SHA-256 of the picture that the service keeps, if there is one. */
const storedPicture = palettes => palettes.find(({ tools }) => tools.some(isBare))?.annotations.empty_box;

/** @param {Props} props */
export function EmptyBox({ box, draft, onProblem }) {
  const { emptyBox, frames } = draft;
  const isOtherSize = emptyBox && frames[0] && sizeOf(emptyBox) !== sizeOf(frames[0]);
  const choose = event => {
    const [file] = event.target.files;
    event.target.value = '';
    if (file) takeEmptyBox(draft, file, onProblem);
  };
  return html`
    <section class="stack tight" aria-labelledby=${HEADING}>
      <h3 id=${HEADING} tabindex="-1">${words.title}</h3>
      <p class="small muted">${words.why}</p>
      <${Field} type="file" label=${words.picture} hint=${words.hint} optional accept="image/*" onInput=${choose} />
      <p class="small muted">${words.otherWays}</p>
      <div role="status">
        ${emptyBox ? html`<img class="empty-box" src=${emptyBox.url} alt=${words.chosen} />`
          : storedPicture(box.palettes) && html`<p class="small">${emptyBox === null ? words.goes : words.kept}</p>`}
      </div>
      ${isOtherSize && html`<${Notice} tone="warn" quiet
        title=${words.otherSize(sizeOf(emptyBox), sizeOf(frames[0]))} />`}
      <${Choices} draft=${draft} isStored=${Boolean(storedPicture(box.palettes))} />
    </section>`;
}

/** The button that takes the choice back, if there is one to take back. */
function Choices({ draft, isStored }) {
  const { emptyBox } = draft;
  if (!emptyBox && !isStored) return null;
  const [label, next] =
    emptyBox === undefined ? [words.remove, null] : [emptyBox ? words.discard : words.keep, undefined];
  const choose = () => (setEmptyBox(draft, next), focusSoon(HEADING));
  return html`<div class="row"><button class="button" type="button" onClick=${choose}>${label}</button></div>`;
}

const sizeOf = ({ width, height }) => `${width} × ${height}`;
