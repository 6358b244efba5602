"""What scripts/test-deploy checks, a module for each kind of file in deploy/."""
