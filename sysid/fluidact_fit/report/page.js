"use strict";
// Tables that sort, pictures that are enlarged and read: the page is whole without it.

function sortable(table) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0];
  const key = (row, column) => row.cells[column].dataset.value ?? row.cells[column].textContent;
  const order = new Intl.Collator(undefined, { numeric: true }).compare;
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      const numeric = head.classList.contains("n");
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
      const keyed = [...body.rows].map((row) => [key(row, column), row]);
      keyed.sort(([a], [b]) => (a === "") - (b === "") || sign * (numeric ? a - b : order(a, b)));
      body.append(...keyed.map(([, row]) => row));
    });
  });
}

function enlargeable(picture) {
  const image = picture.querySelector("img"), caption = picture.parentNode.lastElementChild;
  let zoom = 1;
  const enlarge = (to, x = 0.5, y = 0.5) => {
    zoom = Math.min(Math.max(to, 1), 8);
    image.style.width = `${100 * zoom}%`;
    picture.classList.toggle("enlarged", zoom > 1);
    picture.scrollLeft = x * picture.scrollWidth - picture.clientWidth / 2;
    picture.scrollTop = y * picture.scrollHeight - picture.clientHeight / 2;
  };
  for (const [sign, name, change] of [["+", "Enlarge", 1.5], ["−", "Reduce", 1 / 1.5]]) {
    const button = document.createElement("button");
    button.textContent = sign;
    button.setAttribute("aria-label", `${name}: ${image.dataset.title}`);
    button.addEventListener("click", () => enlarge(zoom * change));
    caption.append(button);
  }
  image.addEventListener("dblclick", (event) => {
    const box = image.getBoundingClientRect();
    enlarge(zoom * 2, (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
  });
}

// Vertices of a line of the picture, and whether each goes on from the one before.
function vertices(svg, id) {
  const path = svg.getElementById(id)?.querySelector(":scope > path, :scope > g > path");
  return [...(path?.getAttribute("d") ?? "").matchAll(/([ML]) (\S+) (\S+)/g)]
    .map((m) => [Number(m[2]), Number(m[3]), m[1] === "L"]);
}

// Height of a line at x, undefined where it has none.
function height(line, x) {
  const k = line.findIndex(([at, , joined], i) => joined && at >= x && line[i - 1][0] <= x);
  if (k < 1) return undefined;
  const [[a, ya], [b, yb]] = [line[k - 1], line[k]];
  return b > a ? ya + ((yb - ya) * (x - a)) / (b - a) : yb;
}

function number(value, [low, high]) {
  const digits = Math.min(Math.max(Math.ceil(3 - Math.log10(Math.abs(high - low) || 1)), 0), 8);
  return value.toFixed(digits).replace("-", "−");
}

function readable(picture) {
  const image = picture.querySelector("img"), panels = JSON.parse(image.dataset.panels ?? "[]");
  const cursor = document.createElement("div"), reading = document.createElement("div");
  cursor.className = "cursor";
  reading.className = "reading";
  for (const part of [cursor, reading]) {
    part.hidden = true;
    part.setAttribute("aria-hidden", "true");
    picture.append(part);
  }
  let svg;
  const read = (panel, fx, fy) => {
    svg ??= new DOMParser().parseFromString(
      new TextDecoder().decode(Uint8Array.from(atob(image.src.split(",")[1]), (c) => c.charCodeAt(0))),
      "image/svg+xml");
    const [, , width, tall] = svg.documentElement.getAttribute("viewBox").split(" ").map(Number);
    const [left, top, right, bottom] = panel.box;
    const at = (fraction, [low, high]) => low + fraction * (high - low);
    const [xName, xUnit] = panel.x_label, [yName, yUnit] = panel.y_label;
    const lines = [[xName, at((fx - left) / (right - left), panel.x), panel.x, xUnit]];
    for (const [id, label] of panel.lines) {
      const y = height((panel.vertices ??= {})[id] ??= vertices(svg, id), fx * width);
      if (y === undefined) continue;
      lines.push([label, at((bottom - y / tall) / (bottom - top), panel.y), panel.y, yUnit]);
    }
    if (lines.length === 1)
      lines.push([yName, at((bottom - fy) / (bottom - top), panel.y), panel.y, yUnit]);
    return lines.map(([n, v, range, unit]) => `${n} ${number(v, range)} ${unit}`.trim()).join("\n");
  };
  image.addEventListener("mousemove", (event) => {
    const box = image.getBoundingClientRect();
    const fx = (event.clientX - box.left) / box.width, fy = (event.clientY - box.top) / box.height;
    const panel = panels.find(({ box: [l, t, r, b] }) => fx >= l && fx <= r && fy >= t && fy <= b);
    cursor.hidden = reading.hidden = !panel;
    if (!panel) return;
    reading.textContent = read(panel, fx, fy);
    const x = fx * image.offsetWidth;
    cursor.style.left = `${x}px`;
    cursor.style.top = `${panel.box[1] * image.offsetHeight}px`;
    cursor.style.height = `${(panel.box[3] - panel.box[1]) * image.offsetHeight}px`;
    reading.style.top = `${Math.max(fy * image.offsetHeight - 30, 0)}px`;
    reading.style.left = `${fx > 0.5 ? x - reading.offsetWidth - 12 : x + 12}px`;
  });
  image.addEventListener("mouseleave", () => (cursor.hidden = reading.hidden = true));
}

document.querySelectorAll("table.sortable").forEach(sortable);
document.querySelectorAll(".picture").forEach((picture) => {
  enlargeable(picture);
  readable(picture);
});
