# make demo   a whole plant from photographs that it draws itself; before it a crown, and leaves with a look
# make test   the whole suite, with lint and types
# make wheel  sdist and wheel in build/wheel, installed into an empty environment and run there
SHELL := /bin/bash
PYTHON_VENV := .venv/bin/python
DEMO := out/demo
# Files keep the order of tests/conftest.py; by the number of their tests, the longest ones would come last.
PYTEST := env -u PYTHONDONTWRITEBYTECODE $(PYTHON_VENV) -m pytest -m "not slow" -n 2 --dist loadfile --no-loadscope-reorder
# Of names, pages and what is declared; they run first, for a minute, since any change may break them.
HOUSE_TESTS := tests/house tests/docs tests/test_remarks.py tests/cli/test_json_output.py

.PHONY: setup setup-test demo test lint bench wheel clean

setup:
	@tools/bootstrap.sh all

setup-test:
	@tools/bootstrap.sh test

demo: setup
	@$(PYTHON_VENV) -m usdfoliage crown tools/demo/crown.jpg --mask tools/demo/crown_mask.png -o $(DEMO)
	@$(PYTHON_VENV) -m usdfoliage scatter -n 400 --seed 1 -o $(DEMO)_leaves
	@$(PYTHON_VENV) -m usdfoliage edit $(DEMO)_leaves --width 1.3 --bend 0.3 --jitter 0.02 12 -o $(DEMO)_look.usda
	@$(PYTHON_VENV) -m usdfoliage preview $(DEMO)_look.usda -o $(DEMO)_look.png
	@rm -rf $(DEMO)_capture
	@$(PYTHON_VENV) tools/synthetic_plant.py $(DEMO)_capture
	@$(PYTHON_VENV) -m usdfoliage build $(DEMO)_capture -o $(DEMO)_plant

lint: setup
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/mypy
	@.venv/bin/lint-imports

test: setup-test lint
	@$(PYTEST) $(HOUSE_TESTS)
	@$(PYTEST) $(addprefix --ignore=,$(HOUSE_TESTS))

bench: setup
	@$(PYTHON_VENV) tools/bench/texture.py
	@$(PYTHON_VENV) tools/bench/mask_proposal.py
	@$(PYTHON_VENV) tools/bench/crown.py
	@$(PYTHON_VENV) tools/bench/leaf.py
	@$(PYTHON_VENV) tools/bench/leaf_asset.py
	@$(PYTHON_VENV) tools/bench/leaf_storm.py
	@$(PYTHON_VENV) tools/bench/looks.py
	@$(PYTHON_VENV) tools/bench/leaf_fit.py
	@$(PYTHON_VENV) tools/bench/leaves.py
	@$(PYTHON_VENV) tools/bench/branches.py
	@$(PYTHON_VENV) tools/bench/box_cost.py
	@$(PYTHON_VENV) tools/bench/hostile_input.py
	@$(PYTHON_VENV) tools/bench/worst_files.py --scale 0.01
	@$(PYTHON_VENV) tools/bench/kills.py --kills 32
	@$(PYTHON_VENV) tools/bench/build_scaling.py --plan-only 1000 | tail -1
	@$(PYTHON_VENV) tools/bench/build_scaling.py
	@$(PYTHON_VENV) tools/bench/build_faults.py
	@$(PYTHON_VENV) tools/bench/depth.py --variants ours plain
	@captures=$$(ls -d ../shared/data/synthetic/*/images 2>/dev/null | xargs -r -n 1 dirname); \
		[ -z "$$captures" ] || $(PYTHON_VENV) tools/bench/poses.py $$captures
	@$(PYTHON_VENV) -m pytest -m slow || [ $$? = 5 ]
	@HYPOTHESIS_PROFILE=explore $(PYTHON_VENV) -m pytest -m "hypothesis and not slow"

wheel: setup
	@tools/wheel.sh

clean:
	rm -rf .venv .venv-preview build out .mypy_cache .ruff_cache .pytest_cache .hypothesis
