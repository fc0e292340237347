# make demo   a photograph to an asset, its preview and its report; leaves and a look; leaves of a capture; a tree
# make test   the whole suite, with lint and types
SHELL := /bin/bash
PYTHON_VENV := .venv/bin/python
DEMO := out/demo

.PHONY: setup setup-test demo test lint bench clean

setup:
	@tools/bootstrap.sh all

setup-test:
	@tools/bootstrap.sh test

demo: setup
	@$(PYTHON_VENV) -m usdfoliage crown tools/demo/crown.jpg --mask tools/demo/crown_mask.png -o $(DEMO)
	@$(PYTHON_VENV) -m usdfoliage scatter -n 400 --seed 1 -o $(DEMO)_leaves
	@$(PYTHON_VENV) -m usdfoliage edit $(DEMO)_leaves --width 1.3 --bend 0.3 --jitter 0.02 12 -o $(DEMO)_look.usda
	@$(PYTHON_VENV) -m usdfoliage preview $(DEMO)_leaves -o $(DEMO)_leaves.png
	@$(PYTHON_VENV) -m usdfoliage preview $(DEMO)_look.usda -o $(DEMO)_look.png
	@rm -rf $(DEMO)_capture
	@$(PYTHON_VENV) tools/synthetic_foliage.py $(DEMO)_capture --leaves 40 --views 4 --size 480 360 --framed 40 --up Z
	@$(PYTHON_VENV) -m usdfoliage leaves $(DEMO)_capture -o $(DEMO)_capture_leaves --report-views 2
	@$(PYTHON_VENV) tools/synthetic_tree.py $(DEMO)_tree.xyz
	@$(PYTHON_VENV) -m usdfoliage branches $(DEMO)_tree.xyz -o $(DEMO)_tree --species maple --foliage template

lint: setup
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/mypy

test: setup-test lint
	@$(PYTHON_VENV) -m pytest -m "not slow"

bench: setup
	@$(PYTHON_VENV) tools/bench/texture.py
	@$(PYTHON_VENV) tools/bench/mask_proposal.py
	@$(PYTHON_VENV) tools/bench/crown.py
	@$(PYTHON_VENV) tools/bench/leaf.py
	@$(PYTHON_VENV) tools/bench/leaf_asset.py
	@$(PYTHON_VENV) tools/bench/leaf_storm.py
	@$(PYTHON_VENV) tools/bench/leaf_fit.py
	@$(PYTHON_VENV) tools/bench/leaves.py
	@$(PYTHON_VENV) tools/bench/branches.py
	@$(PYTHON_VENV) tools/bench/hostile_input.py
	@$(PYTHON_VENV) tools/bench/depth.py --variants ours plain
	@captures=$$(ls -d ../shared/data/synthetic/*/images 2>/dev/null | xargs -r -n 1 dirname); \
		[ -z "$$captures" ] || $(PYTHON_VENV) tools/bench/registration.py $$captures
	@$(PYTHON_VENV) -m pytest -m slow || [ $$? = 5 ]
	@HYPOTHESIS_PROFILE=explore $(PYTHON_VENV) -m pytest -m "hypothesis and not slow"

clean:
	rm -rf .venv .venv-preview build out .mypy_cache .ruff_cache .pytest_cache .hypothesis
