// Finds what has too little contrast on the page as it is drawn: letters, also those of drawings, which axe leaves out,
// marks, lines and borders that say something, and what letters become when they are pointed at. WCAG 2.1: 4.5 to 1 for letters, 3 to 1 for large ones and for
// graphics (success criteria 1.4.3 and 1.4.11); relative luminance as defined there.
(given, states) => {
  const canvas = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const known = new Map();

  // (r, g, b) in 0..255 and alpha in 0..1 of any colour that CSS has.
  function color(text) {
    if (!known.has(text)) {
      const plain = /^rgba?\(([\d.]+), ([\d.]+), ([\d.]+)(?:, ([\d.]+))?\)$/.exec(text);
      let found = plain && [+plain[1], +plain[2], +plain[3], plain[4] === undefined ? 1 : +plain[4]];
      if (!found) {
        canvas.clearRect(0, 0, 1, 1);
        canvas.fillStyle = text;
        canvas.fillRect(0, 0, 1, 1);
        const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
        found = [r, g, b, a / 255];
      }
      known.set(text, found);
    }
    return known.get(text);
  }

  const over = (top, below) => [0, 1, 2].map((k) => top[k] * top[3] + below[k] * (1 - top[3])).concat(1);

  function luminance(rgb) {
    const [r, g, b] = rgb.slice(0, 3).map((code) => {
      const c = code / 255;
      return c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  }

  function ratio(a, b) {
    const [low, high] = [luminance(a), luminance(b)].sort((one, two) => one - two);
    return (high + 0.05) / (low + 0.05);
  }

  // What lies behind an element: the colours of its ancestors up to the first that lets nothing through; null behind
  // which a picture or a gradient is.
  function behind(element) {
    const layers = [];
    for (let one = element; one; one = one.parentElement) {
      const style = getComputedStyle(one);
      if (style.backgroundImage !== "none") return null;
      const layer = color(style.backgroundColor);
      layers.push(layer);
      if (layer[3] === 1) break;
    }
    const paper = matchMedia("(prefers-color-scheme: dark)").matches && getComputedStyle(document.documentElement).colorScheme.includes("dark");
    return layers.reverse().reduce((below, layer) => over(layer, below), paper ? [18, 18, 18, 1] : [255, 255, 255, 1]);
  }

  function opacity(element) {
    let all = 1;
    for (let one = element; one; one = one.parentElement) all *= +getComputedStyle(one).opacity;
    return all;
  }

  function seen(element) {
    return element.checkVisibility({ checkOpacity: true, checkVisibilityCSS: true, contentVisibilityAuto: false });
  }

  function where(element) {
    const classes = (one) => (one.getAttribute("class") || "").trim().split(/\s+/).filter(Boolean);
    const named = (one) => [one.localName, ...classes(one)].join(".");
    return classes(element.parentElement).length ? `${named(element.parentElement)} > ${named(element)}` : named(element);
  }

  const found = new Map();
  let letters = 0;
  let marks = 0;

  function hold(element, paint, least, below, words) {
    const top = color(paint);
    const made = ratio(over([...top.slice(0, 3), top[3] * opacity(element)], below), below);
    const key = `${where(element)} ${paint} on ${below.slice(0, 3).map(Math.round)}`;
    if (made < least - 0.005 && !found.has(key)) found.set(key, `${key}: ${made.toFixed(2)} of ${least}${words}`);
  }

  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    const words = walker.currentNode.data.trim();
    if (!words || element.closest("script, style, noscript, template, title, option") || !seen(element)) continue;
    const box = element.getBoundingClientRect();
    if (box.width <= 1 || box.height <= 1 || element.closest("[disabled]")) continue;
    const style = getComputedStyle(element);
    const drawn = element instanceof SVGElement;
    const below = behind(drawn ? element.ownerSVGElement : element);
    if (!below) continue;
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && +style.fontWeight >= 700);
    letters += 1;
    hold(element, drawn ? style.fill : style.color, large ? 3 : 4.5, below, ` in "${words.slice(0, 40)}"`);
  }

  // [selector, property of its style, property of an opacity or ""]
  for (const [selector, property, clear] of given) {
    for (const element of document.querySelectorAll(selector)) {
      if (!seen(element)) continue;
      const style = getComputedStyle(element);
      const below = behind(element instanceof SVGElement ? element.ownerSVGElement : element.parentElement);
      if (!below) continue;
      const [r, g, b, a] = color(style[property]);
      marks += 1;
      hold(element, `rgba(${r}, ${g}, ${b}, ${a * (clear ? +style[clear] : 1)})`, 3, below, ` by its ${property}`);
    }
  }
  // [letters, paper]: properties of the theme, for what is seen only while the pointer is there
  const probe = document.body.appendChild(document.createElement("span"));
  const theme = getComputedStyle(document.body);
  for (const pair of states) {
    if (!pair.every((name) => theme.getPropertyValue(name))) continue;
    const [top, paper] = pair.map((name) => {
      probe.style.color = `var(${name})`;
      return getComputedStyle(probe).color;
    });
    marks += 1;
    hold(probe, top, 4.5, over(color(paper), [255, 255, 255, 1]), ` of ${pair.join(" on ")}`);
  }
  probe.remove();
  return { scheme: document.body.dataset.mdColorScheme || "", dark: luminance(behind(document.body)) < 0.2, letters, marks,
    found: [...found.values()] };
}
