// Step 2: photos of the board, from this device's camera or from files. Each is judged at once, while the board is at
// hand.
import { html, useState } from '../preact.js';
import { t } from '../texts.js';
import { focusSoon } from '../parts/forms/focus.js';
import { Field } from '../parts/forms/form.js';
import { Announce, Notice, ProblemNotice } from '../parts/page/notice.js';
import { CoverageMap } from './coverage.js';
import { needsOf, TILTS } from './photo_needs.js';
import { PhotoCard } from './photo_card.js';
import { addPhotos, boardOf, goodPhotos, removePhoto, retry, usualSize } from './photos.js';
import { CameraShot } from './camera_shot.js';

const words = t.setup.photos;

/** @param {Props} props */
export function PhotosStep({ box, draft, stepHref }) {
  const [problem, setProblem] = useState(null);
  const { photos, plan } = draft;
  const add = files => addPhotos(draft, box.id, files, setProblem);
  const choose = event => {
    add([...event.target.files]);
    event.target.value = '';
  };
  const remove = photo => (removePhoto(draft, photo), focusSoon('photos-so-far', 'setup-step'));
  const good = goodPhotos(photos);
  const size = usualSize(photos.filter(({ check }) => check?.found));
  const latest = [...photos].reverse().find(({ state }) => state === 'checked' || state === 'failed');
  return html`
    <p class="small muted">${words.withBoard(boardOf(plan), plan.square)} <a href=${stepHref('board')}>${words.otherBoard}</a></p>
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
    <div class="setup-two">
      <div class="stack">
        <${CameraShot} calibrated=${box.calibration} label=${words.take} onShot=${blob => add([blob])} />
        <${Field} type="file" label=${words.choose} hint=${words.chooseHint} accept="image/*" multiple onInput=${choose} />
      </div>
      <${Needs} good=${good} taken=${photos.length} />
    </div>
    <${Announce}>${latest ? words.heard(latest) : ''}<//>
    ${photos.length > 0 && html`
      <section class="stack">
        <h3 id="photos-so-far" tabindex="-1">${words.sofar(good.length, photos.length)}</h3>
        <ul class="photos">
          ${[...photos].reverse().map(photo => html`
            <${PhotoCard} key=${photo.id} photo=${photo} usual=${size} onRemove=${() => remove(photo)}
              onRetry=${() => retry(draft, box.id, photo)} />`)}
        </ul>
      </section>`}`;
}

/** What the next photo should show. */
function Needs({ good, taken }) {
  const needs = needsOf(good);
  if (good.length === 0)
    return html`<div class="stack"><h3>${words.how}</h3>
      <ul class="bullets">${words.hints.map(hint => html`<li key=${hint}>${hint}</li>`)}</ul>
      ${taken > 0 && html`<${Notice} tone="warn" quiet title=${words.noneGood} />`}</div>`;
  return html`
    <div class="stack">
      <h3>${words.next}</h3>
      <${CoverageMap} needs=${needs} photos=${good} />
      <ul class="bullets">
        ${needs.missing.length > 0 && html`<li>${words.missing(needs.missing)}</li>`}
        ${needs.untilted.length > 0 && html`<li>${words.untilted(needs.untilted)}</li>`}
        ${needs.more > 0 && html`<li>${words.more(needs.more)}</li>`}
        ${needs.isEnough && html`<li>${words.enough}</li>`}
      </ul>
      <dl class="facts small">${TILTS.map(side => html`<dt key=${side}>${words.tilted[side]}</dt>
        <dd>${words.count(needs.tilts[side])}</dd>`)}</dl>
      <p class="small muted">${words.rough}</p>
    </div>`;
}
