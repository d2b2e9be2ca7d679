"""``python -m faultloop``"""

from faultloop.cli import main

if __name__ == "__main__":
    main()
