// Everything that is stored about a person, as a ZIP file to save.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { t } from '../../texts.js';

const words = t.ownData;

/** The links that save it. @param {Props} props */
export const DataLinks = ({ trainee }) => html`
  <p class="row"><a class="button" href=${api.trainees.dataAddress(trainee, false)} download>${words.save}</a>
    <a class="button" href=${api.trainees.dataAddress(trainee, true)} download>${words.saveWithVideos}</a></p>`;

/** @param {Props} props */
export const OwnData = ({ trainee }) => html`
  <section class="card unprinted">
    <header><h2>${words.title}</h2></header>
    <div class="body stack"><p class="small muted">${words.body}</p><${DataLinks} trainee=${trainee} /></div>
  </section>`;
