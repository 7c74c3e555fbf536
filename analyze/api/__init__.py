"""The public API behind `import analyze`: recordings, estimates and plans as notebooks use them."""
