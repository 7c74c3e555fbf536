"""Rules that every page of the console keeps, computed in the browser from what it has drawn."""

from __future__ import annotations

CONTRAST = """() => {
    const canvas = new OffscreenCanvas(1, 1).getContext('2d', {willReadFrequently: true});
    const known = new Map();
    const rgba = text => {
        if (known.has(text)) return known.get(text);
        canvas.clearRect(0, 0, 1, 1);
        canvas.fillStyle = text;
        canvas.fillRect(0, 0, 1, 1);
        const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
        known.set(text, [r, g, b, a / 255]);
        return known.get(text);
    };
    const over = ([r, g, b, a], under) => [r, g, b].map((v, i) => v * a + under[i] * (1 - a));
    const luminance = colour => colour.map(v => v / 255)
        .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
    const ground = node => {
        const layers = [];
        for (let each = node; each; each = each.parentElement) {
            const colour = rgba(getComputedStyle(each).backgroundColor);
            if (colour[3] > 0) layers.push(colour);
            if (colour[3] === 1) break;
        }
        return layers.reverse().reduce((under, layer) => over(layer, under), [255, 255, 255]);
    };
    const found = [];
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
        const parent = node.parentElement;
        if (!node.data.trim() || !parent.checkVisibility()) continue;
        if (parent.closest('script, option, .unseen, h1')) continue;
        const style = getComputedStyle(parent);
        const drawn = parent.closest('svg') ? style.fill : style.color;
        const under = ground(parent);
        const [a, b] = [luminance(over(rgba(drawn), under)), luminance(under)];
        const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        if (ratio < 4.5) found.push(`${node.data.trim().slice(0, 30)}: ${ratio.toFixed(2)}`);
    }
    return found;
}"""
"""texts with a contrast below 4.5"""

OVERFLOW = """() => [...document.querySelectorAll('body *')].filter(node => {
    if (node.closest('.unseen, h1, dialog, svg') || !node.checkVisibility()) return false;
    const box = node.getBoundingClientRect();
    return box.width > 0 && (box.right > innerWidth + 0.5 || box.left < -0.5);
}).map(node => `${node.tagName} ${node.id} ${node.className.baseVal ?? node.className}`)"""
"""elements that reach beyond the window"""

CUT = """() => [...document.querySelectorAll('body *')].filter(node => {
    if (node.closest('.unseen, h1, select, svg, .scroll') || !node.checkVisibility()) return false;
    const inline = getComputedStyle(node).display === 'inline';
    return !inline && node.clientWidth > 0 && node.scrollWidth > node.clientWidth + 1;
}).map(node => `${node.tagName} ${node.id} ${node.className}: ${node.scrollWidth} > ${node.clientWidth}`)"""
"""elements whose content is wider than they are"""

DRAWN_OUTSIDE = """() => [...document.querySelectorAll('main svg text')].filter(text => {
    if (!text.checkVisibility()) return false;
    const [box, plot] = [text.getBoundingClientRect(), text.ownerSVGElement.getBoundingClientRect()];
    return box.left < plot.left - 1 || box.right > plot.right + 1 || box.top < plot.top - 1 ||
        box.bottom > plot.bottom + 1;
}).map(text => text.textContent)"""
"""labels of plots that are cut"""

UNNAMED = """() => {
    const name = node => (node.getAttribute('aria-label') || node.labels?.[0]?.textContent ||
        document.getElementById(node.getAttribute('aria-labelledby'))?.textContent || node.alt ||
        node.textContent).trim();
    return [...document.querySelectorAll('button, a, input, select, img, svg[role], dialog, nav')]
        .filter(node => node.checkVisibility() && !name(node)).map(node => node.outerHTML.slice(0, 80));
}"""
"""controls and pictures without an accessible name"""

STOP = """() => {
    const box = node => node.getBoundingClientRect();
    const area = node => box(node).width * box(node).height;
    const stop = document.getElementById('stop');
    const {left, right, top, bottom} = box(stop);
    const seen = left >= 0 && right <= innerWidth && top >= 0 && bottom <= innerHeight;
    const hit = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    const larger = [...document.querySelectorAll('button')]
        .filter(node => node !== stop && node.id !== 'card-open' && node.checkVisibility())
        .filter(node => area(node) >= area(stop));
    return {seen, hit: stop.contains(hit), enabled: !stop.disabled, larger: larger.map(node => node.id)};
}"""
"""whether the stop button is in sight, on top, enabled; buttons that are as large"""

FOCUS_ORDER = """() => [...document.querySelectorAll(
        'a[href], button, input, select, summary, [tabindex="0"]')]
    .filter(node => node.checkVisibility() && !node.disabled && !node.closest('dialog:not([open])'))
    .map(node => node.id || node.dataset.view || node.textContent.trim())"""
"""controls in the order of the document"""

RULES = {
    "contrast": CONTRAST,
    "overflow": OVERFLOW,
    "cut": CUT,
    "labels of plots": DRAWN_OUTSIDE,
    "names": UNNAMED,
}
"""rules that return what breaks them"""
