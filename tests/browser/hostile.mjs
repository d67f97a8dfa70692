// Texts that try to run as code, and a check that no page executed or rendered them.

/** Each text calls `hit()` if a page treats it as anything but text. */
export const HOSTILE = [
  '<script>hit()</script>',
  '</script><script>hit()</script>',
  '"><script>hit()</script>',
  "'><script>hit()</script>",
  '<SCRIPT SRC=data:text/javascript,hit()></SCRIPT>',
  '<scr<script>ipt>hit()</scr</script>ipt>',
  '<script\x20type="module">hit()</script>',
  '<img src=x onerror=hit()>',
  '"><img src=x onerror=hit()>',
  "'><img src=x onerror=hit()>",
  '<img src=x onerror="hit()"//>',
  '<IMG """><SCRIPT>hit()</SCRIPT>">',
  '<img/src=x/onerror=hit()>',
  '<image href=x onerror=hit()>',
  '<svg onload=hit()>',
  '<svg/onload=hit()>',
  '<svg><script>hit()</script></svg>',
  '<svg><animate onbegin=hit() attributeName=x dur=1s>',
  '<svg><a xlink:href="javascript:hit()"><text>x</text></a>',
  '<svg><use href="data:image/svg+xml,<svg onload=hit()>"/>',
  '<math><mtext></mtext><mglyph><style><img src=x onerror=hit()>',
  '<body onload=hit()>',
  '<body onpageshow=hit()>',
  '<iframe src="javascript:hit()"></iframe>',
  '<iframe srcdoc="<script>parent.hit()</script>"></iframe>',
  '<object data="javascript:hit()"></object>',
  '<embed src="javascript:hit()">',
  '<a href="javascript:hit()">here</a>',
  '<a href="JaVaScRiPt&colon;hit()">here</a>',
  '<form action="javascript:hit()"><button>go</button></form>',
  '<button formaction="javascript:hit()" autofocus>',
  '<input autofocus onfocus=hit()>',
  '<select autofocus onfocus=hit()>',
  '<textarea autofocus onfocus=hit()>',
  '<details open ontoggle=hit()>',
  '<video src=x onerror=hit()>',
  '<video><source onerror=hit()></video>',
  '<audio src=x onerror=hit()>',
  '<marquee onstart=hit()>',
  '<style>@import "javascript:hit()";</style>',
  '<link rel=stylesheet href="javascript:hit()">',
  '<meta http-equiv=refresh content="0;javascript:hit()">',
  '<base href="javascript:hit()//">',
  '<div style="background:url(javascript:hit())">',
  '<div onmouseover=hit()>over</div>',
  '<p style="animation-name:x" onanimationstart=hit()>',
  '<template><script>hit()</script></template>',
  '<noscript><p title="</noscript><img src=x onerror=hit()>">',
  '<!--><img src=x onerror=hit()>-->',
  '<![CDATA[<img src=x onerror=hit()>]]>',
  '" onmouseover="hit()',
  "' onfocus='hit()' autofocus='",
  '` onerror=hit() `',
  '${hit()}',
  '{{hit()}}',
  '{{constructor.constructor("hit()")()}}',
  '#{hit()}',
  'javascript:hit()',
  'data:text/html,<script>hit()</script>',
  '&lt;script&gt;hit()&lt;/script&gt;',
  '&#60;img src=x onerror=hit()&#62;',
  '\u200f<script>hit()</script>',
];

/** Elements that none of our pages contains: injected text that became an element, a script or an event handler. */
export const injectedElements = page =>
  page.evaluate(() => {
    const ours = /^\/kept\/[\w-]+\/(app|theme_first|modules_first)\.js$/;
    const scripts = [...document.scripts].filter(({ src }) => !ours.test(new URL(src || 'about:blank').pathname));
    const elements = document.querySelectorAll(
      'iframe, object, embed, base, marquee, math, form[action], [formaction], a[href^="javascript:" i], body ~ *, main style',
    );
    const handlers = [...document.querySelectorAll('*')].filter(({ attributes }) =>
      [...attributes].some(({ name }) => name.startsWith('on')));
    return [...scripts, ...elements, ...handlers].map(({ outerHTML }) => outerHTML.slice(0, 200));
  });
