"use strict";
document.documentElement.classList.add("live");

/* The turntable: dragged, turned by its slider, or playing, for good or while the mouse is over it. */
for (const table of document.querySelectorAll(".turntable")) {
  const stage = table.querySelector(".turn");
  const frames = [...stage.querySelectorAll("img")];
  const slider = table.querySelector("input");
  const button = table.querySelector("button");
  if (!slider) continue;
  const count = frames.length;
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  let current = 0, playing = false, over = false, grabbed = null, timer = 0;
  const show = (frame) => {
    frames[current].classList.remove("on");
    current = ((frame % count) + count) % count;
    frames[current].classList.add("on");
    slider.value = current;
    slider.setAttribute("aria-valuetext", Math.round((360 * current) / count) + " degrees");
  };
  const settle = () => {
    clearInterval(timer);
    const runs = grabbed === null && (playing || (over && !calm.matches));
    if (runs) timer = setInterval(() => show(current + 1), 7000 / count);
    button.textContent = playing ? "Pause" : "Play";
    button.setAttribute("aria-pressed", String(playing));
  };
  const stop = () => { playing = over = false; settle(); };
  button.addEventListener("click", () => { playing = !playing; over = false; settle(); });
  slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
  slider.addEventListener("keydown", (event) => {
    if (event.key !== " ") return;
    event.preventDefault();
    button.click();
  });
  stage.addEventListener("pointerenter", (event) => { over = event.pointerType === "mouse"; settle(); });
  stage.addEventListener("pointerleave", () => { over = false; settle(); });
  stage.addEventListener("pointerdown", (event) => {
    playing = over = false;
    grabbed = { x: event.clientX, frame: current };
    stage.setPointerCapture(event.pointerId);
    stage.classList.add("grabbed");
    settle();
  });
  stage.addEventListener("pointermove", (event) => {
    /* A drag to the right turns the front to the right, as a hand would: the camera turns in the opposite direction. */
    if (grabbed) show(grabbed.frame - Math.round(((event.clientX - grabbed.x) / stage.clientWidth) * count));
  });
  for (const end of ["pointerup", "pointercancel"]) {
    stage.addEventListener(end, () => { grabbed = null; stage.classList.remove("grabbed"); settle(); });
  }
}

/* The bar between a photograph and the plant. */
for (const slider of document.querySelectorAll(".pair input")) {
  const place = () => {
    slider.parentNode.style.setProperty("--at", slider.value + "%");
    slider.setAttribute("aria-valuetext", Math.round(slider.value) + " %");
  };
  slider.addEventListener("input", place);
  slider.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: -2, ArrowDown: -2, ArrowRight: 2, ArrowUp: 2, PageDown: -10, PageUp: 10 };
    if (!(event.key in steps)) return;
    event.preventDefault();
    slider.value = Number(slider.value) + steps[event.key];
    place();
  });
  place();
}

/* Which photograph is compared. */
for (const group of document.querySelectorAll(".comparisons")) {
  const figures = [...group.querySelectorAll(".compare")];
  const choices = [...group.querySelectorAll(".choose input")];
  const choose = () => {
    const chosen = Math.max(0, choices.findIndex((choice) => choice.checked));
    figures.forEach((figure, number) => { figure.hidden = number !== chosen; });
  };
  for (const choice of choices) choice.addEventListener("change", choose);
  choose();
}

/* Pictures of the stages, as large as the window. */
const dialog = document.querySelector("dialog");
for (const button of document.querySelectorAll(".zoom")) {
  button.addEventListener("click", () => {
    const large = dialog.querySelector("img"), small = button.querySelector("img");
    large.src = small.src;
    large.alt = small.alt;
    dialog.showModal();
  });
}
dialog.addEventListener("click", () => dialog.close());

/* How long it took: in a file beside the page, since no two runs take the same time. */
function usdfoliageTimings(timings) {
  const section = document.getElementById("times");
  const add = (parent, name, text, kind) => {
    const made = document.createElement(name);
    if (text !== undefined) made.textContent = text;
    if (kind) made.className = kind;
    return parent.appendChild(made);
  };
  const seconds = (value) => Number(value).toFixed(value < 10 ? 2 : 1) + " s";
  const fill = (parent, heading, rows) => {
    const table = add(add(parent, "div", undefined, "scroll long"), "table");
    const head = add(table, "tr");
    for (const name of heading) add(head, "th", name, name === "time" ? "number" : "");
    for (const row of rows) {
      const line = add(table, "tr");
      row.forEach((cell, number) => add(line, "td", cell, heading[number] === "time" ? "number" : ""));
    }
  };
  const how = (row) => (row.cached ? "was there" : "run");
  add(section.querySelector("summary"), "span", " " + seconds(timings.seconds) + ", " + timings.executor, "soft");
  fill(section, ["stage", "time", ""], timings.stages.map((row) => [row.stage, seconds(row.seconds), how(row)]));
  if (timings.tasks.length) {
    add(section, "h3", "Tasks");
    fill(section, ["stage", "task", "time", ""], timings.tasks.map((row) => [row.stage, row.name, seconds(row.seconds), how(row)]));
  }
  section.hidden = false;
}
const times = document.createElement("script");
times.src = document.getElementById("times").dataset.file;
document.head.appendChild(times);
