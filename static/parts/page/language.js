// The choice of the page's language. Each language is named in itself, so that people find it who cannot read the
// others.
import { html } from '../../preact.js';
import { chooseLanguage, language, LANGUAGES, t } from '../../texts.js';
import { icons } from './icons.js';

const ALL = Object.entries(LANGUAGES);

/** As buttons, where there is space. */
export const LanguageChoice = () => html`
  <div class="row languages" role="group" aria-label=${t.language}>
    ${ALL.map(([code, name]) => html`<button key=${code} class="button" type="button" lang=${code} aria-pressed=${code === language}
      onClick=${() => code !== language && chooseLanguage(code)}>${name}</button>`)}
  </div>`;

/** Behind an icon, beside the theme's: the browser's own menu lies invisibly over the icon. */
export const LanguageMenu = () => html`
  <label class="button bare language-menu" title=${t.language}>
    <${icons.globe} /><span class="unseen">${t.language}</span>
    <select onChange=${event => chooseLanguage(event.target.value)}>
      ${ALL.map(([code, name]) => html`<option key=${code} value=${code} lang=${code} selected=${code === language}>${name}</option>`)}
    </select>
  </label>`;
