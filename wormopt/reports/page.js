"use strict";
// The page can be read without any of this. Worms: a slider and a button in place of poses that
// stand still, or of the first frame. Sweeps: one map at a time, whose cells open a point.

const svg = (figure, name) => [...figure.querySelectorAll(name)];

function worm(figure) {
  const data = JSON.parse(figure.querySelector("script").textContent);
  const [first, last, count] = data.time;
  const lanes = svg(figure, ".stage .lane").map((lane, k) => ({
    ...data.lanes[k],
    world: lane.querySelector(".world"),
    links: svg(lane, ".link"),
    masses: svg(lane, ".mass"),
    bars: svg(lane, ".bar"),
  }));
  const rod = figure.querySelector(".stage .rod");
  const shown = (value) => String(+value.toPrecision(3)).replace("-", "−");

  function show(frame) {
    for (const lane of lanes) {
      const at = lane.x.map((row) => (row[frame] - data.origin) * data.scale + data.pad);
      at.forEach((x, i) => {
        lane.masses[i].setAttribute("transform", `translate(${x.toFixed(2)} 0)`);
        lane.masses[i].classList.toggle("rests", !!lane.rests && lane.rests[i][frame] === "1");
        if (lane.load) {
          lane.bars[i].setAttribute("height", Math.abs(lane.load[i][frame] * data.bar).toFixed(1));
          lane.bars[i].classList.toggle("back", lane.load[i][frame] < 0);
        }
      });
      lane.links.forEach((link, j) => {
        link.setAttribute("x1", at[j].toFixed(2));
        link.setAttribute("x2", at[j + 1].toFixed(2));
      });
      if (data.follow.length) {
        lane.world.setAttribute("transform", `translate(${-data.follow[frame]} 0)`);
      }
    }
    if (rod) {
      const places = data.rod[frame];
      let path = "";
      for (let k = 0; k < places.length; k += 2) path += `${k ? "L" : "M"}${places[k]} ${places[k + 1]}`;
      rod.setAttribute("d", path);
    }
    const time = first + ((last - first) * frame) / (count - 1);
    const at = lanes.length === 1 && lanes[0].rests
      ? lanes[0].rests.flatMap((row, i) => (row[frame] === "1" ? [i] : [])).join(", ") || "none"
      : "";
    return `t = ${shown(time)}${data.unit ? ` ${data.unit}` : ""}${at ? `, at rest: ${at}` : ""}`;
  }

  figure.querySelector(".stage").hidden = false;
  play(figure, count, 6, show);
}

// Frames that are all in one drawing.
function film(figure) {
  const frames = [];
  for (const part of svg(figure, ".frame")) {
    const k = +part.getAttribute("class").match(/f(\d+)/)[1];
    (frames[k] ||= []).push(part);
  }
  let before = [];
  play(figure, frames.length, frames.length / 8, (frame) => {
    for (const part of before) part.classList.remove("now");
    before = frames[frame];
    for (const part of before) part.classList.add("now");
    return `frame ${frame} of ${frames.length}`;
  });
}

// A button and a slider over frames; show(frame) draws one and returns words for it.
function play(figure, count, seconds, show) {
  const slider = figure.querySelector(".slider");
  const button = figure.querySelector(".play");
  const now = figure.querySelector(".now");
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  function turn(frame) {
    const text = show(frame);
    now.textContent = text;
    slider.setAttribute("aria-valuetext", text);
    slider.style.setProperty("--done", `${(100 * frame) / (count - 1)}%`);
  }

  let playing = 0;
  function stop() {
    cancelAnimationFrame(playing);
    playing = 0;
    button.textContent = "Play";
    button.setAttribute("aria-pressed", "false");
  }
  function start() {
    if (playing) return stop();
    let at = +slider.value >= count - 1 ? 0 : +slider.value;
    let before = performance.now();
    button.textContent = "Pause";
    button.setAttribute("aria-pressed", "true");
    const step = (when) => {
      at += ((when - before) / 1000 / seconds) * (count - 1);
      before = when;
      if (at > count - 1) {
        if (still.matches) { // whoever wants little motion sees it once
          slider.value = count - 1;
          turn(count - 1);
          return stop();
        }
        at -= count - 1;
      }
      slider.value = Math.floor(at);
      turn(+slider.value);
      playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
  }

  button.addEventListener("click", start);
  slider.addEventListener("input", () => {
    if (playing) stop();
    turn(+slider.value);
  });
  slider.addEventListener("keydown", (key) => {
    if (key.key === " ") {
      key.preventDefault();
      start();
    }
  });
  figure.classList.add("live");
  turn(0);
}

function sweep(whole) {
  const maps = svg(whole, ".map");
  const chooser = whole.querySelector(".choose");
  const panel = whole.querySelector(".panel");
  const table = whole.querySelector(".rows");
  const names = table ? [...table.tHead.rows[0].cells].map((cell) => cell.textContent) : [];

  function choose(name) {
    for (const map of maps) map.hidden = map.id !== name;
  }
  if (chooser) {
    const select = chooser.querySelector("select");
    chooser.hidden = false;
    select.addEventListener("change", () => choose(select.value));
    choose(select.value);
  }

  // What opens is moved into the panel and back: its parts and ids are on the page once.
  let lent = null;
  function open(point) {
    if (lent) lent.home.append(lent.body);
    const body = panel.querySelector(".panel-body");
    const home = whole.querySelector(`.point[data-point="${point}"]`);
    lent = home ? { home, body: home.lastElementChild } : null;
    const row = document.getElementById(`${whole.id.replace("-sweep", "")}-row${point}`);
    body.replaceChildren();
    if (row) body.append(facts([...row.cells].map((cell) => cell.textContent)));
    if (lent) body.append(lent.body);
    const any = whole.querySelector(`.map:not([hidden]) .cell[data-point="${point}"]`);
    const place = any ? any.getAttribute("aria-label").split(": ")[0] : row ? place_of(row) : "";
    panel.querySelector(".panel-title").textContent = place;
    panel.hidden = false;
    for (const cell of svg(whole, ".cell")) {
      if (cell.dataset.point === point) cell.setAttribute("aria-current", "true");
      else cell.removeAttribute("aria-current");
    }
    panel.scrollIntoView({ block: "nearest" });
  }
  function place_of(row) {
    const last = names.indexOf("status");
    return names.slice(0, last).map((name, k) => `${name} = ${row.cells[k].textContent}`).join(", ");
  }
  function facts(values) {
    const list = document.createElement("dl");
    list.className = "facts";
    names.forEach((name, k) => {
      if (k < names.indexOf("status")) return;
      const term = document.createElement("dt");
      const value = document.createElement("dd");
      term.textContent = name;
      value.textContent = values[k];
      list.append(term, value);
    });
    return list;
  }
  whole.addEventListener("click", (event) => {
    const cell = event.target.closest("a.cell");
    if (!cell) return;
    event.preventDefault();
    open(cell.dataset.point);
  });

  // A map is one stop of the tabulator; arrows go from cell to cell.
  for (const map of maps) {
    const rows = map.querySelector("table")
      ? [...map.querySelectorAll("tbody tr")].map((row) => [...row.querySelectorAll(".cell")])
      : [svg(map, "a.cell")];
    rows.flat().forEach((cell) => cell.setAttribute("tabindex", "-1"));
    rows[0][0]?.setAttribute("tabindex", "0");
    map.addEventListener("keydown", (key) => {
      const step = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[key.key];
      const row = rows.findIndex((cells) => cells.includes(document.activeElement));
      if (!step || row < 0) return;
      const to = rows[row + step[0]]?.[rows[row].indexOf(document.activeElement) + step[1]];
      if (!to) return;
      key.preventDefault();
      document.activeElement.setAttribute("tabindex", "-1");
      to.setAttribute("tabindex", "0");
      to.focus();
    });
  }
  whole.classList.add("live");
}

document.querySelectorAll("figure.moving").forEach(worm);
document.querySelectorAll("figure.film").forEach(film);
document.querySelectorAll(".sweep").forEach(sweep);
